# `cmake --install build --prefix <where>`: the program in bin/, OpenVINO's libraries in lib/airslam/,
# the model packs in share/airslam/models/. The program finds both from its own place.
set(ov_libs ${AIRSLAM_OPENVINO}/libs)
# The second place is OpenVINO's wheel, seen from airslam/bin/ of the Python package.
set_target_properties(airslam PROPERTIES INSTALL_RPATH "$ORIGIN/../lib/airslam:$ORIGIN/../../openvino/libs")
install(TARGETS airslam RUNTIME DESTINATION bin)
install(DIRECTORY ${ov_libs}/ DESTINATION lib/airslam
        FILES_MATCHING
        PATTERN "libopenvino.so*"
        PATTERN "libopenvino_intel_cpu_plugin.so"
        PATTERN "libopenvino_onnx_frontend.so*"
        PATTERN "libopenvino_ir_frontend.so*"
        PATTERN "libtbb*.so*"
        PATTERN "libhwloc.so*")
install(DIRECTORY ${CMAKE_SOURCE_DIR}/models/ DESTINATION share/airslam/models)
