submapd_fuzzer(fuzz_configuration SOURCES fuzz_configuration.cpp LIBS submapd_daemon)
submapd_fuzzer(fuzz_journal SOURCES fuzz_journal.cpp LIBS submapd_daemon)
submapd_fuzzer(fuzz_control SOURCES fuzz_control.cpp LIBS submapd_daemon)
submapd_fuzzer(fuzz_odometry SOURCES fuzz_odometry.cpp LIBS submapd_daemon)
