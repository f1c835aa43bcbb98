// The daemon's messages: to stderr, with journald's priority prefixes when a journal reads them.
//
// Any thread but the real-time ones (usb, mapper), which count instead and let the control thread tell.
#pragma once

#include <string_view>

namespace submapd {

enum class Severity { kInfo, kWarning, kError };

// Call once before the first message. `foreground`: for a person at a terminal, time and severity in words.
void open_log(bool foreground);

void log(Severity severity, std::string_view message);

}  // namespace submapd
