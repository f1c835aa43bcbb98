// The scans of one scanner as the raw log of a run has them, file after file, also while it is being written.
//
// Damage and a last event that is not whole yet are left out. One thread; blocks on the disk.
#pragma once

#include <filesystem>
#include <memory>

#include "driver/sensor_roles.hpp"
#include "proto/channels.hpp"
#include "slam/output/point_cloud.hpp"

namespace submapd {

// Errors: kIo (the folder cannot be read). A folder without raw logs has no scans.
[[nodiscard]] Expected<std::unique_ptr<CloudScans>> open_recorded_scans(const std::filesystem::path& run,
                                                                        const Channels& channels,
                                                                        driver::SensorRole role);

}  // namespace submapd
