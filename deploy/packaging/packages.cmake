# Debian packages: `cpack` in the build folder, or deploy/package.sh. Five packages, so that a station needs no server and a
# server no station: telenano-common holds what both read (scenes, scans, documents), telenano-dev the libraries (library.cmake).
set(share share/telenano)
foreach(pair telenano-nve:server telenano-afm-sim:server telenano-master:station telenano-lab:lab)
  string(REPLACE : ";" pair ${pair})
  list(GET pair 0 program)
  list(GET pair 1 component)
  if(TARGET ${program})
    install(TARGETS ${program} RUNTIME DESTINATION bin COMPONENT ${component})
  endif()
endforeach()

# Each program tells bash how to complete it.
set(completions ${PROJECT_BINARY_DIR}/completions)
file(MAKE_DIRECTORY ${completions})
add_custom_target(programs)  # what is packed, without tests; programs-server, -station, -lab: for one package each
foreach(component server station lab dev)
  add_custom_target(programs-${component})
  add_dependencies(programs programs-${component})
endforeach()
foreach(pair telenano-nve:server telenano-afm-sim:server telenano-master:station telenano-lab:lab)
  string(REPLACE : ";" pair ${pair})
  list(GET pair 0 program)
  list(GET pair 1 component)
  if(TARGET ${program})
    add_custom_target(${program}-completion ALL
                      COMMAND sh -c "'$<TARGET_FILE:${program}>' --completion >'${completions}/${program}'" VERBATIM)
    add_dependencies(programs-${component} ${program}-completion)
    install(FILES ${completions}/${program} DESTINATION share/bash-completion/completions COMPONENT ${component})
  endif()
endforeach()

add_dependencies(programs-dev ${telenano_folders})
install(DIRECTORY deploy/examples DESTINATION share/doc/telenano-dev COMPONENT dev)

install(DIRECTORY deploy/scenes deploy/data DESTINATION ${share} COMPONENT common)
# What `telenano-lab precision --only ground` compares with.
install(DIRECTORY tests/data/elastic DESTINATION ${share} COMPONENT lab FILES_MATCHING PATTERN "*.csv")
install(FILES proto/PROTOCOL.md proto/telenano.proto proto/telenano.lua DESTINATION ${share}/proto COMPONENT common)
install(FILES deploy/OPERATIONS.md CHANGELOG.md DESTINATION share/doc/telenano-common COMPONENT common)
install(DIRECTORY deploy/docs DESTINATION share/doc/telenano-common COMPONENT common FILES_MATCHING PATTERN "*.md")
install(FILES deploy/station.toml DESTINATION ${share} COMPONENT station)
install(FILES deploy/afm.toml DESTINATION ${share} COMPONENT server)
# For the controller's computer, to be copied there.
install(PROGRAMS deploy/afm/deadman.py DESTINATION ${share}/afm COMPONENT server)
install(FILES deploy/afm/deadman.toml DESTINATION ${share}/afm COMPONENT server)
foreach(component common server station lab dev)
  install(FILES LICENSE DESTINATION share/doc/telenano-${component} RENAME copyright COMPONENT ${component})
endforeach()

install(FILES deploy/systemd/telenano-nve.service deploy/systemd/telenano-nve-afm-guard.socket
              deploy/systemd/telenano-nve-afm-guard@.service DESTINATION lib/systemd/system COMPONENT server)
install(FILES deploy/systemd/telenano-server.sysusers DESTINATION lib/sysusers.d RENAME telenano-server.conf COMPONENT server)
install(FILES deploy/systemd/telenano-server.tmpfiles DESTINATION lib/tmpfiles.d RENAME telenano-server.conf COMPONENT server)
install(FILES deploy/systemd/nve.env DESTINATION /etc/telenano COMPONENT server)
install(FILES deploy/systemd/telenano-realtime.conf DESTINATION /etc/security/limits.d COMPONENT station)
install(FILES deploy/systemd/telenano-station.sysusers DESTINATION lib/sysusers.d RENAME telenano-station.conf COMPONENT station)
file(GLOB udev_rules ${PROJECT_SOURCE_DIR}/deploy/udev/*.rules)
if(udev_rules)
  install(FILES ${udev_rules} DESTINATION lib/udev/rules.d COMPONENT station)
endif()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_PACKAGE_NAME telenano)
set(CPACK_PACKAGE_VENDOR Telenano)
set(CPACK_PACKAGE_CONTACT "Telenano <telenano@localhost>")
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_COMPONENTS_ALL common server station lab dev)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
# Of the text only the part of each component: its first line is the package's own.
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "Networked haptic tele-nanomanipulation")
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
foreach(component common server station lab dev)
  string(TOUPPER ${component} upper)
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME telenano-${component})
endforeach()
set(exact "(= ${PROJECT_VERSION})")
set(CPACK_DEBIAN_COMMON_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_COMMON_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_SERVER_PACKAGE_DEPENDS "telenano-common ${exact}, systemd | systemd-standalone-sysusers")
set(CPACK_DEBIAN_SERVER_PACKAGE_RECOMMENDS "libjs-three")
set(CPACK_DEBIAN_SERVER_PACKAGE_SUGGESTS "gwyddion")
set(CPACK_DEBIAN_LAB_PACKAGE_DEPENDS "telenano-common ${exact}")
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS
    "g++, cmake (>= 3.25), pkg-config, libeigen3-dev, libfmt-dev, libhdf5-dev, libprotobuf-dev, libssl-dev, libtomlplusplus-dev")
set(CPACK_DEBIAN_LAB_PACKAGE_RECOMMENDS "gnuplot-nox")
set(CPACK_DEBIAN_STATION_PACKAGE_DEPENDS "systemd | systemd-standalone-sysusers")
set(CPACK_DEBIAN_STATION_PACKAGE_SUGGESTS "gnuplot-nox, telenano-common")
set(CPACK_COMPONENT_COMMON_DESCRIPTION "Telenano: scenes, scans and documents
 What server and laboratory read: scenes (TOML), AFM scans (Gwyddion
 Simple Field), the protocol's specification and its Wireshark dissector.")
set(CPACK_COMPONENT_SERVER_DESCRIPTION "Telenano: the nanoscale virtual environment's server
 Computes what an AFM tip feels and serves it to haptic stations over UDP,
 encrypted off loopback.")
set(CPACK_COMPONENT_STATION_DESCRIPTION "Telenano: the haptic station
 Lets an operator with a haptic device feel an AFM tip touch a sample at
 the nanoscale, kept stable by a passivity controller.")
set(CPACK_COMPONENT_LAB_DESCRIPTION "Telenano: the laboratory
 Studies and benchmarks: contact mechanics, control, Z-width, network
 impairments, reports of recordings.")
set(CPACK_COMPONENT_DEV_DESCRIPTION "Telenano: the libraries, to build upon
 Headers and static libraries for CMake's find_package(telenano): protocol,
 transport, control, device, station, contact, scene, server; examples.")
set(scripts ${PROJECT_SOURCE_DIR}/deploy/packaging)
set(CPACK_DEBIAN_SERVER_PACKAGE_CONTROL_EXTRA
    "${scripts}/server/conffiles;${scripts}/server/postinst;${scripts}/server/prerm;${scripts}/server/postrm")
set(CPACK_DEBIAN_STATION_PACKAGE_CONTROL_EXTRA "${scripts}/station/conffiles;${scripts}/station/postinst")
include(CPack)
