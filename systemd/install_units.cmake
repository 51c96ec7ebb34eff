# When Waymark is installed: writes both units from the one template. Wants `source`, this folder,
# and `output`, a folder for the results.
set(BINDIR "${CMAKE_INSTALL_PREFIX}/bin")

set(CONFIGURATION "/etc/waymark/waymarkd.toml")
set(DIRECTORY "waymark")
set(OF_WHICH "")
configure_file("${source}/waymarkd.service.in" "${output}/waymarkd.service" @ONLY)

set(CONFIGURATION "/etc/waymark/%i.toml")
set(DIRECTORY "waymark-%i")
set(OF_WHICH " (%i)")
configure_file("${source}/waymarkd.service.in" "${output}/waymarkd@.service" @ONLY)

file(INSTALL "${output}/waymarkd.service" "${output}/waymarkd@.service"
     DESTINATION "${CMAKE_INSTALL_PREFIX}/lib/systemd/system")
