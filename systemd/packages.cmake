# Debian packages by CPack: submapd (daemon), submapd-tools (tools), libsubmapd-types-java (java).
set(packages ${CMAKE_CURRENT_BINARY_DIR}/packages)

# gzip without name and time: the same input gives the same package.
find_program(GZIP gzip REQUIRED)
function(submapd_gzip SOURCE TARGET)
  add_custom_command(OUTPUT ${TARGET} COMMAND ${GZIP} -9nc ${SOURCE} > ${TARGET} DEPENDS ${SOURCE} VERBATIM)
endfunction()

submapd_gzip(${CMAKE_CURRENT_SOURCE_DIR}/debian/changelog ${packages}/changelog.gz)
set(documents ${packages}/changelog.gz)

# submapd_man_page(COMPONENT PAGE): PAGE ends in its section's number.
function(submapd_man_page COMPONENT PAGE)
  get_filename_component(name ${PAGE} NAME)
  string(REGEX MATCH "[0-9]$" section ${name})
  submapd_gzip(${PAGE} ${packages}/${name}.gz)
  install(FILES ${packages}/${name}.gz DESTINATION share/man/man${section} COMPONENT ${COMPONENT})
  set(documents ${documents} ${packages}/${name}.gz PARENT_SCOPE)
endfunction()

# submapd.toml(5) comes from the page of the keys, and that is tested against the program.
find_package(Python3 REQUIRED COMPONENTS Interpreter)
set(keys ${PROJECT_SOURCE_DIR}/daemon/configuration.md)
set(pages ${PROJECT_SOURCE_DIR}/daemon/man)
file(MAKE_DIRECTORY ${packages})
add_custom_command(
  OUTPUT ${packages}/submapd.toml.5
  COMMAND Python3::Interpreter ${pages}/write_toml_page.py ${keys} ${pages}/submapd.toml.5.in ${packages}/submapd.toml.5
  DEPENDS ${keys} ${pages}/write_toml_page.py ${pages}/submapd.toml.5.in VERBATIM)
submapd_man_page(daemon ${packages}/submapd.toml.5)
submapd_man_page(daemon ${pages}/submapd.8)
submapd_man_page(tools ${PROJECT_SOURCE_DIR}/tools/submapctl/submapctl.1)
submapd_man_page(tools ${PROJECT_SOURCE_DIR}/tools/hokuyo_sim/hokuyo-sim.1)
submapd_man_page(tools ${PROJECT_SOURCE_DIR}/proto/submap-spy.1)

# submapd_package(COMPONENT NAME DESCRIPTION LONG): what all packages share.
macro(submapd_package COMPONENT NAME DESCRIPTION LONG)
  string(TOUPPER ${COMPONENT} upper)
  install(FILES ${packages}/changelog.gz debian/copyright DESTINATION share/doc/${NAME} COMPONENT ${COMPONENT})
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${NAME})
  # The first line is the short description.
  set(CPACK_COMPONENT_${upper}_DESCRIPTION "${DESCRIPTION}\n${LONG}")
endmacro()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME submapd)
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "")  # each package has its own
set(CPACK_PACKAGE_VENDOR "the submapd developers")
set(CPACK_PACKAGE_DIRECTORY ${CMAKE_BINARY_DIR}/packages)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_COMPONENTS_ALL daemon tools)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_DEBIAN_PACKAGE_MAINTAINER "the submapd developers <submapd@localhost>")
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)

submapd_package(daemon submapd "indoor mapping daemon with on-board laser SLAM"
"Takes two Hokuyo UTM-30LX laser scanners over USB, maps while the cart they
stand on rolls, closes loops live, and saves the map when the operator asks
for it. Starts with the machine and waits for its scanners.")
# iproute2: the multicast route. deb-systemd-helper is essential enough to be everywhere but in the smallest containers.
set(CPACK_DEBIAN_DAEMON_PACKAGE_DEPENDS "systemd, udev, iproute2, init-system-helpers (>= 1.51)")
set(CPACK_DEBIAN_DAEMON_PACKAGE_RECOMMENDS "submapd-tools (= ${PROJECT_VERSION})")
set(scripts ${CMAKE_CURRENT_SOURCE_DIR}/debian)
set(CPACK_DEBIAN_DAEMON_PACKAGE_CONTROL_EXTRA
  "${scripts}/conffiles;${scripts}/postinst;${scripts}/prerm;${scripts}/postrm")
set(CPACK_DEBIAN_DAEMON_PACKAGE_CONTROL_STRICT_PERMISSION ON)

submapd_package(tools submapd-tools "control, replay and emulation tools of the submapd mapping daemon"
"submapctl controls the daemon, replays its logs and simulates worlds for it;
hokuyo-sim emulates UTM-30LX scanners; submap-spy shows messages.")
set(CPACK_DEBIAN_TOOLS_PACKAGE_RECOMMENDS "bash-completion")
set(CPACK_DEBIAN_TOOLS_PACKAGE_SUGGESTS "liblcm-bin, umockdev, libsubmapd-types-java, libjchart2d-java, default-jre")

if(SUBMAPD_JAVA)
  list(APPEND CPACK_COMPONENTS_ALL java)
  submapd_package(java libsubmapd-types-java "LCM types of the submapd mapping daemon for Java"
"The messages of submapd for Java programs; with it submap-spy shows them as
they come.")
  set(CPACK_DEBIAN_JAVA_PACKAGE_ARCHITECTURE all)
  set(CPACK_DEBIAN_JAVA_PACKAGE_SECTION java)
  set(CPACK_DEBIAN_JAVA_PACKAGE_SHLIBDEPS OFF)
  set(CPACK_DEBIAN_JAVA_PACKAGE_DEPENDS liblcm-java)
endif()

add_custom_target(package_documents ALL DEPENDS ${documents})
include(CPack)
