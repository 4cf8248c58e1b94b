# Flags shared by every target of the project. Floating-point contraction stays at the compiler's
# default and no -ffast-math is used: equal input must give equal bits on one CPU type.
add_library(airslam_flags INTERFACE)
target_include_directories(airslam_flags INTERFACE ${CMAKE_SOURCE_DIR}/src)
target_compile_options(airslam_flags INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Werror)
if(AIRSLAM_FUZZ)
  if(NOT CMAKE_CXX_COMPILER_ID MATCHES Clang)
    message(FATAL_ERROR "AIRSLAM_FUZZ needs clang: -DCMAKE_CXX_COMPILER=clang++")
  endif()
  # Warnings are g++'s to judge. Coverage for libFuzzer, and what finds mistakes in memory.
  target_compile_options(airslam_flags INTERFACE -Wno-error -g1 -fno-omit-frame-pointer
                         -fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=undefined)
  target_link_options(airslam_flags INTERFACE -fsanitize=address,undefined)
endif()
if(AIRSLAM_SANITIZE OR AIRSLAM_FUZZ)
  # With AddressSanitizer Eigen would align its memory by hand, and free by hand what Ceres has
  # allocated with glibc's malloc, which aligns it anyway.
  target_compile_definitions(airslam_flags INTERFACE EIGEN_MALLOC_ALREADY_ALIGNED=1)
endif()
if(AIRSLAM_SANITIZE)
  target_compile_options(airslam_flags INTERFACE -fsanitize=${AIRSLAM_SANITIZE} -fno-omit-frame-pointer -g)
  # GCC takes instrumented std::optional for uninitialized; the plain build still warns.
  target_compile_options(airslam_flags INTERFACE -Wno-maybe-uninitialized)
  target_link_options(airslam_flags INTERFACE -fsanitize=${AIRSLAM_SANITIZE})
endif()

# airslam_layer(<name> DEPENDS <layers and libraries>... [TEST_DEPENDS <...>] [ONE_TEST])
#
# Declares one layer: every .cc of the calling folder becomes the library airslam_<name>; every
# *_test.cc becomes part of the program airslam_<name>_test, registered with CTest. DEPENDS may name
# only layers above this one in the list of docs/architecture.md. ONE_TEST: CTest runs the whole test
# program at once, because its tests share something that is dear to make; long, it starts early (COST).
function(airslam_layer name)
  cmake_parse_arguments(LAYER "ONE_TEST" "" "DEPENDS;TEST_DEPENDS" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS *.cc)
  file(GLOB tests CONFIGURE_DEPENDS *_test.cc)
  if(tests)
    list(REMOVE_ITEM sources ${tests})
  endif()
  if(sources)
    add_library(airslam_${name} STATIC ${sources})
    target_link_libraries(airslam_${name} PUBLIC airslam_flags ${LAYER_DEPENDS})
  else()
    add_library(airslam_${name} INTERFACE)
    target_link_libraries(airslam_${name} INTERFACE airslam_flags ${LAYER_DEPENDS})
  endif()
  if(AIRSLAM_TESTS AND tests)
    add_executable(airslam_${name}_test ${tests})
    target_link_libraries(airslam_${name}_test PRIVATE airslam_${name} ${LAYER_TEST_DEPENDS}
                          GTest::gtest GTest::gmock GTest::gtest_main)
    target_compile_definitions(airslam_${name}_test PRIVATE
      AIRSLAM_SOURCE_DIR="${CMAKE_SOURCE_DIR}" AIRSLAM_BINARY_DIR="${CMAKE_BINARY_DIR}")
    if(LAYER_ONE_TEST)
      add_test(NAME ${name} COMMAND airslam_${name}_test)
      set_tests_properties(${name} PROPERTIES TIMEOUT 600 COST 90)
    else()
      gtest_discover_tests(airslam_${name}_test TEST_PREFIX ${name}. DISCOVERY_TIMEOUT 60
                           PROPERTIES TIMEOUT 600)
    endif()
  endif()
endfunction()
