// Writes into the configuration file which scanner is the horizontal one and which the vertical one.
//
// Everything else in the file stays as it is, comments too. Pure functions but for assign_roles(); any thread.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slam/base/status.hpp"

namespace submapd::tools {

struct RoleAssignment {
  std::string horizontal;               // serial number
  std::optional<std::string> vertical;  // nothing: there is no vertical scanner
};

// From "H=SERIAL" and "V=SERIAL". kInvalidArgument with what is wrong: H must be there, both must differ.
[[nodiscard]] Expected<RoleAssignment> parse_assignment(const std::vector<std::string>& words);

// The text of a configuration file with these serial numbers in its section [scanner]. Ports that were configured for a
// role are emptied, because a serial number is surer.
[[nodiscard]] std::string with_roles(std::string_view configuration, const RoleAssignment& roles);

// Changes the file, or makes it. It is replaced as a whole or not at all. kInvalidArgument if it is no configuration.
[[nodiscard]] Status assign_roles(const std::string& path, const RoleAssignment& roles);

}  // namespace submapd::tools
