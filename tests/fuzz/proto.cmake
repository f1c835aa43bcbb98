submapd_fuzzer(fuzz_submap SOURCES fuzz_submap.cpp LIBS submapd_slam ZLIB::ZLIB)
submapd_fuzzer(fuzz_submap_chunk SOURCES fuzz_submap_chunk.cpp LIBS submapd_proto)
