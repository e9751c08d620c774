# The libraries as others use them: `find_package(telenano)` after an install (package telenano-dev), or add_subdirectory and
# FetchContent, with the same names. See deploy/docs/library.md.
#
# A room is what one links; it brings its folders' libraries with it.
#   telenano_room(NAME DOES "what it is for" FOLDERS targets ...)
set(telenano_rooms "")
function(telenano_room name)
  cmake_parse_arguments(arg "" "" "FOLDERS" ${ARGN})
  add_library(telenano_room_${name} INTERFACE)
  target_link_libraries(telenano_room_${name} INTERFACE ${arg_FOLDERS})
  set_target_properties(telenano_room_${name} PROPERTIES EXPORT_NAME ${name})
  add_library(telenano::${name} ALIAS telenano_room_${name})
  set(telenano_rooms ${telenano_rooms} telenano_room_${name} PARENT_SCOPE)
endfunction()

telenano_room(protocol FOLDERS telenano_link)                                      # messages, codec, sessions of both sides
telenano_room(transport FOLDERS telenano_net telenano_security telenano_connection)  # UDP, DTLS, keys, the way to a server
telenano_room(control FOLDERS telenano_control)                                    # methods, energy, planning, Z-width
telenano_room(device FOLDERS telenano_device)                                      # the seam of a haptic device, and devices without one
telenano_room(station FOLDERS telenano_station telenano_loop telenano_device)      # the station's step, and one tick of its loop
telenano_room(contact FOLDERS telenano_physics telenano_surface)                   # laws, potentials, surfaces
telenano_room(scene FOLDERS telenano_scene)                                        # scene files to contact
telenano_room(server FOLDERS telenano_slave telenano_server)                       # the seam of a slave, the NVE, the server's loop
telenano_room(twin FOLDERS telenano_twin telenano_station_scene)                   # the server's scene, run by the station
telenano_room(recording FOLDERS telenano_recording)                                # HDF5 files of sessions

# What the rooms bring. A folder that is new here is missed at the configuration, by install(EXPORT).
set(telenano_folders telenano_base telenano_config telenano_connection telenano_control telenano_device telenano_hash telenano_link
    telenano_loop telenano_net telenano_physics telenano_proto telenano_recording telenano_rt telenano_sample telenano_scene
    telenano_security telenano_server telenano_slave telenano_station telenano_station_scene telenano_surface telenano_twin)

# Headers of a folder, once. Names begin with telenano/ in the build tree as they do when installed.
set(folders_seen "")
foreach(target ${telenano_folders})
  string(REPLACE telenano_ "" name ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME folder_${name} OUTPUT_NAME telenano_${name})
  get_target_property(folder ${target} SOURCE_DIR)
  if(target STREQUAL telenano_proto OR folder IN_LIST folders_seen)
    continue()
  endif()
  list(APPEND folders_seen ${folder})
  file(RELATIVE_PATH inside ${PROJECT_SOURCE_DIR} ${folder})
  file(GLOB headers CONFIGURE_DEPENDS RELATIVE ${folder} ${folder}/*.h)
  file(GLOB inner CONFIGURE_DEPENDS RELATIVE ${folder} ${folder}/*/*.h)
  foreach(header ${inner})  # its rooms; a folder with a list of its own is another library
    get_filename_component(room ${header} DIRECTORY)
    if(NOT EXISTS ${folder}/${room}/CMakeLists.txt)
      list(APPEND headers ${header})
    endif()
  endforeach()
  foreach(header ${headers})  # what is made of telenano.proto is for the codec alone
    file(STRINGS ${folder}/${header} made REGEX "^#include \"proto/")
    if(made)
      list(REMOVE_ITEM headers ${header})
    endif()
  endforeach()
  list(TRANSFORM headers PREPEND ${telenano_include}/telenano/${inside}/)
  target_sources(${target} PUBLIC FILE_SET HEADERS BASE_DIRS ${telenano_include} FILES ${headers})
endforeach()

if(PROJECT_IS_TOP_LEVEL)
  include(CMakePackageConfigHelpers)
  set(package lib/cmake/telenano)
  install(TARGETS ${telenano_rooms} ${telenano_folders} EXPORT telenano
          ARCHIVE DESTINATION lib/telenano COMPONENT dev
          FILE_SET HEADERS DESTINATION include COMPONENT dev)
  install(EXPORT telenano NAMESPACE telenano:: FILE telenanoTargets.cmake DESTINATION ${package} COMPONENT dev)
  configure_package_config_file(deploy/packaging/telenanoConfig.cmake.in ${PROJECT_BINARY_DIR}/telenanoConfig.cmake
                                INSTALL_DESTINATION ${package})
  write_basic_package_version_file(${PROJECT_BINARY_DIR}/telenanoConfigVersion.cmake COMPATIBILITY SameMinorVersion)
  install(FILES ${PROJECT_BINARY_DIR}/telenanoConfig.cmake ${PROJECT_BINARY_DIR}/telenanoConfigVersion.cmake
          DESTINATION ${package} COMPONENT dev)
endif()
