submapd_fuzzer(fuzz_scip SOURCES fuzz_scip.cpp LIBS submapd_driver)
submapd_fuzzer(fuzz_usbip SOURCES fuzz_usbip.cpp LIBS submapd_usb_emulation)
