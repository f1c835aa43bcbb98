// Gives submapd_test_headers something to compile.
