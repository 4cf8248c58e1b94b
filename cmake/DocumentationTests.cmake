# The documentation says what the program and the records say, and its links lead somewhere.
find_program(DOCUMENTATION_PYTHON python3 REQUIRED PATHS /usr/bin NO_DEFAULT_PATH)
add_test(NAME docs.generated COMMAND ${DOCUMENTATION_PYTHON} ${CMAKE_SOURCE_DIR}/scripts/docs/generate.py
         --check --airslam $<TARGET_FILE:airslam>)
add_test(NAME docs.benchmarks COMMAND ${DOCUMENTATION_PYTHON} ${CMAKE_SOURCE_DIR}/benchmarks/render.py --check)
add_test(NAME docs.links COMMAND ${DOCUMENTATION_PYTHON} ${CMAKE_SOURCE_DIR}/scripts/docs/check_links.py)
add_test(NAME docs.links_checker COMMAND ${DOCUMENTATION_PYTHON} ${CMAKE_SOURCE_DIR}/scripts/docs/check_links_test.py)
add_test(NAME docs.renderer COMMAND ${DOCUMENTATION_PYTHON} ${CMAKE_SOURCE_DIR}/benchmarks/render_test.py)
