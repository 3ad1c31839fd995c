# `cmake --install` and Debian packages (`make package`), a component each. A part's own README.md goes to its
# documentation, the changes as changelog.gz; the manual pages are what the programs say of themselves.
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS .ci/package/CHANGES.md)
set(FATHOM_CHANGELOG ${CMAKE_BINARY_DIR}/share/doc/changelog.gz)
file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/share/doc)
execute_process(COMMAND gzip -9nc ${CMAKE_SOURCE_DIR}/.ci/package/CHANGES.md
  OUTPUT_FILE ${FATHOM_CHANGELOG} COMMAND_ERROR_IS_FATAL ANY)
function(fathom_package component)
  cmake_parse_arguments(ARG "" "SUMMARY;GUIDE;DEPENDS;SUGGESTS" "PROGRAMS" ${ARGN})
  install(TARGETS ${ARG_PROGRAMS} DESTINATION bin COMPONENT ${component})
  install(FILES ${ARG_GUIDE} ${FATHOM_CHANGELOG} DESTINATION share/doc/fathom-${component} COMPONENT ${component})
  set(pages "")
  foreach(program ${ARG_PROGRAMS})
    set(page ${CMAKE_BINARY_DIR}/share/man/man1/${program}.1.gz)
    add_custom_command(OUTPUT ${page} COMMAND ${CMAKE_SOURCE_DIR}/.ci/package/man $<TARGET_FILE:${program}> ${page}
      DEPENDS ${program} ${CMAKE_SOURCE_DIR}/.ci/package/man COMMENT "Writing the manual page of ${program}" VERBATIM)
    list(APPEND pages ${page})
  endforeach()
  install(FILES ${pages} DESTINATION share/man/man1 COMPONENT ${component})
  add_custom_target(fathom_${component}_manual DEPENDS ${pages})
  add_dependencies(programs ${ARG_PROGRAMS} fathom_${component}_manual)

  string(TOUPPER ${component} key)
  set(CPACK_COMPONENT_${key}_DESCRIPTION ${ARG_SUMMARY} PARENT_SCOPE)
  set(CPACK_DEBIAN_${key}_PACKAGE_NAME fathom-${component} PARENT_SCOPE)
  set(CPACK_DEBIAN_${key}_PACKAGE_DEPENDS "${ARG_DEPENDS}" PARENT_SCOPE)
  set(CPACK_DEBIAN_${key}_PACKAGE_SUGGESTS "${ARG_SUGGESTS}" PARENT_SCOPE)
endfunction()

# What a person runs: the five programs, their pages on the web and in the manual.
add_custom_target(programs)
fathom_package(onboard PROGRAMS fathom-onboard fathom-sensors DEPENDS systemd
  SUMMARY "Fathom on the vehicle: maps the seafloor during the dive, and checks the devices before it"
  GUIDE realtime/onboard/README.md)
fathom_package(topside PROGRAMS fathom-topside SUGGESTS snakemake
  SUMMARY "Fathom after recovery: makes a dive's 3D model and shows it"
  GUIDE recon/topside/README.md)
fathom_package(monitor PROGRAMS fathom-monitor
  SUMMARY "Fathom on the ship: shows the map that comes over the acoustic link"
  GUIDE telemetry/monitor/README.md)
fathom_package(sim PROGRAMS fathom-sim SUGGESTS "fathom-onboard, iproute2"
  SUMMARY "Fathom's simulated sea: makes dives with their truth, plays and scores them"
  GUIDE sim/README.md)
set(CPACK_COMPONENT_DEVELOPMENT_DESCRIPTION
  "Fathom's libraries for other programs: pose-graph solver, stereo matching, codec of maps, decoders of DVL and NMEA 2000")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libfathom-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS "libeigen3-dev, libisal-dev, libopencv-dev, libproj-dev, libsuitesparse-dev, \
libtomlplusplus-dev, nlohmann-json3-dev, pkg-config")
foreach(page fathom_monitor_page fathom_topside_page)
  if(TARGET ${page})
    add_dependencies(programs ${page})
  endif()
endforeach()
add_dependencies(programs development fathom_stepped_clock)

set(service realtime/onboard/service)
foreach(file "fathom-onboard.service lib/systemd/system fathom-onboard.service" "sysusers.conf lib/sysusers.d fathom-onboard.conf"
    "tmpfiles.conf lib/tmpfiles.d fathom-onboard.conf" "sysctl.conf lib/sysctl.d 60-fathom-onboard.conf"
    "udev.rules lib/udev/rules.d 60-fathom-onboard.rules" "onboard.toml /etc/fathom onboard.toml")
  separate_arguments(file)
  list(POP_FRONT file from to name)
  install(FILES ${service}/${from} DESTINATION ${to} RENAME ${name} COMPONENT onboard)
endforeach()
install(DIRECTORY ${CMAKE_BINARY_DIR}/share/fathom/topside DESTINATION share/fathom COMPONENT topside)
install(DIRECTORY recon/topside/workflow DESTINATION share/fathom COMPONENT topside)
install(DIRECTORY ${CMAKE_BINARY_DIR}/share/fathom/monitor DESTINATION share/fathom COMPONENT monitor)
install(DIRECTORY sim/scenarios sim/hil/faults DESTINATION share/fathom COMPONENT sim)
install(TARGETS fathom_stepped_clock DESTINATION lib/fathom COMPONENT sim)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_SET_DESTDIR ON) # for /etc
set(CPACK_STRIP_FILES ON)
set(CPACK_VERBATIM_VARIABLES ON)
set(CPACK_COMPONENTS_ALL onboard topside monitor sim development)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_MAINTAINER "Fathom <fathom@localhost>")
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(control ${CMAKE_SOURCE_DIR}/.ci/package/onboard)
set(CPACK_DEBIAN_ONBOARD_PACKAGE_CONTROL_EXTRA ${control}/conffiles ${control}/postinst ${control}/prerm ${control}/postrm)
include(CPack)
