// Where a run keeps its files, and who it is: STATE/runs/RUN and the cart's identity in STATE/cart-uuid.
//
// Set-up code, one thread.
#pragma once

#include <filesystem>
#include <string>

#include "daemon/run_clock.hpp"
#include "slam/base/ids.hpp"
#include "slam/base/status.hpp"

namespace submapd {

struct RunFolder {
  std::filesystem::path path;
  std::string name;  // YYYYmmdd-HHMMSS-XXXX in UTC, the last four from the run's id
  Uuid cart;
  Uuid run;
  RunClock clock{0};

  [[nodiscard]] std::filesystem::path submaps() const { return path / "submaps"; }
  [[nodiscard]] std::filesystem::path maps() const { return path / "maps"; }
  [[nodiscard]] std::filesystem::path journal() const { return path / "journal"; }
  [[nodiscard]] std::filesystem::path poses() const { return path / "poses"; }
};

// Makes the folder of a new run, with its submaps/ and maps/, and the cart's identity if it has none. `state` is made
// if it is missing. STATE/current-run names the run from here on. Errors: kIo, kCorrupt (cart-uuid holds something
// else); nothing is left of the run then.
[[nodiscard]] Expected<RunFolder> begin_run(const std::filesystem::path& state, const RunClock& clock);

// Of a run that could not begin, with all that is in its folder; as far as the disk lets it.
void discard_run(const RunFolder& folder);

}  // namespace submapd
