submapd_fuzzer(fuzz_g2o SOURCES fuzz_g2o.cpp LIBS submapd_slam)
submapd_fuzzer(fuzz_tum SOURCES fuzz_tum.cpp LIBS submapd_slam)
submapd_fuzzer(fuzz_poses SOURCES fuzz_poses.cpp LIBS submapd_slam)
