# find_package(waymark): the message types, for subscribers. Defines waymark::lcmtypes.
find_path(WAYMARK_LCM_INCLUDE_DIR lcm/lcm.h)
find_library(WAYMARK_LCM_LIBRARY lcm)
mark_as_advanced(WAYMARK_LCM_INCLUDE_DIR WAYMARK_LCM_LIBRARY)
if(NOT WAYMARK_LCM_INCLUDE_DIR OR NOT WAYMARK_LCM_LIBRARY)
  set(waymark_FOUND FALSE)
  set(waymark_NOT_FOUND_MESSAGE "LCM is missing; the Debian package is liblcm-dev")
elseif(NOT TARGET waymark::lcmtypes)
  add_library(waymark::lcmtypes INTERFACE IMPORTED)
  get_filename_component(waymark_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
  set_target_properties(waymark::lcmtypes PROPERTIES
    INTERFACE_INCLUDE_DIRECTORIES
      "${waymark_prefix}/include/waymark-lcmtypes;${WAYMARK_LCM_INCLUDE_DIR}"
    INTERFACE_LINK_LIBRARIES "${WAYMARK_LCM_LIBRARY}")
  unset(waymark_prefix)
endif()
