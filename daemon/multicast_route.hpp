// Whether LCM could send now. Asked first, because liblcm prints a page of advice each time it cannot.
//
// Any thread; a few microseconds.
#pragma once

#include <string>

namespace submapd {

// True if the system has a route to the group of a udpm:// URL, and for any other URL.
[[nodiscard]] bool has_multicast_route(const std::string& url);

}  // namespace submapd
