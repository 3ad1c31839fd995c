# What other projects take by find_package(fathom): the libraries that stand by themselves, the headers of each, and what
# they link (component `development`). Headers keep their paths, below include/fathom.
include(CMakePackageConfigHelpers)
add_custom_target(development)

# `target` becomes fathom::`name`. Then its headers: globs from the project's root.
function(fathom_development name target)
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
  target_compile_features(${target} PUBLIC cxx_std_20)
  target_include_directories(${target} INTERFACE $<INSTALL_INTERFACE:include/fathom>)
  target_compile_definitions(${target} INTERFACE $<INSTALL_INTERFACE:${FATHOM_EIGEN}>)
  add_dependencies(development ${target})
  install(TARGETS ${target} EXPORT fathom ARCHIVE DESTINATION lib/fathom COMPONENT development)
  file(GLOB_RECURSE headers RELATIVE ${CMAKE_SOURCE_DIR} CONFIGURE_DEPENDS ${ARGN})
  list(FILTER headers EXCLUDE REGEX "(_impl|\\.inl)\\.hpp$")
  foreach(header IN LISTS headers)
    cmake_path(GET header PARENT_PATH folder)
    install(FILES ${header} DESTINATION include/fathom/${folder} COMPONENT development)
  endforeach()
endfunction()

fathom_development(base fathom_base realtime/base/*.hpp)
fathom_development(kernel fathom_kernel realtime/kernel/*.hpp)
fathom_development(geometry fathom_geometry recon/geometry/*.hpp)
fathom_development(solver fathom_solver recon/solver/*.hpp)
fathom_development(stereo fathom_stereo recon/stereo/*.hpp)
fathom_development(map_codec fathom_map_codec telemetry/map/*.hpp)
fathom_development(decoders fathom_decoders firmware_if/devices/dvl/dvl_sample.hpp firmware_if/devices/dvl/ensemble_stream.hpp
  firmware_if/devices/dvl/pd*.hpp firmware_if/devices/can/can_frame.hpp firmware_if/devices/can/can_text.hpp firmware_if/devices/can/fast_packet.hpp
  firmware_if/devices/can/n2k_decoder.hpp firmware_if/devices/can/n2k_definitions.hpp firmware_if/devices/can/raw_can.hpp)

install(EXPORT fathom NAMESPACE fathom:: FILE fathomTargets.cmake DESTINATION lib/cmake/fathom COMPONENT development)
configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/fathomConfig.cmake.in ${CMAKE_BINARY_DIR}/fathomConfig.cmake
  INSTALL_DESTINATION lib/cmake/fathom)
write_basic_package_version_file(${CMAKE_BINARY_DIR}/fathomConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/fathomConfig.cmake ${CMAKE_BINARY_DIR}/fathomConfigVersion.cmake
  DESTINATION lib/cmake/fathom COMPONENT development)
