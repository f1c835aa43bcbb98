submapd_fuzzer(fuzz_scip SOURCES fuzz_scip.cpp LIBS submapd_driver)
