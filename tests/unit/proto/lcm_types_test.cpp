// Released message types never change: whoever logged or reads them elsewhere has these fingerprints.
#include <gtest/gtest.h>

#include <cstdint>
#include <string>

#include "submapd/command_t.hpp"
#include "submapd/graph_t.hpp"
#include "submapd/health_t.hpp"
#include "submapd/intensities_t.hpp"
#include "submapd/odometry_t.hpp"
#include "submapd/pose_t.hpp"
#include "submapd/reply_t.hpp"
#include "submapd/scan_t.hpp"
#include "submapd/submap_chunk_t.hpp"
#include "submapd/trigger_t.hpp"

namespace submapd {
namespace {

struct Fingerprint {
  std::string type;
  std::uint64_t hash;
  std::uint64_t released;
};

// A new field is a new type with a new line here; a line is never edited.
const Fingerprint kFingerprints[] = {
    {"command_t", static_cast<std::uint64_t>(command_t::getHash()), 0x9ad3447a36ef2795U},
    {"graph_t", static_cast<std::uint64_t>(graph_t::getHash()), 0xc613abe19eb9761dU},
    {"health_t", static_cast<std::uint64_t>(health_t::getHash()), 0x29c615d28c03e07cU},
    {"intensities_t", static_cast<std::uint64_t>(intensities_t::getHash()), 0x0a4fcc712505bcd3U},
    {"loop_t", static_cast<std::uint64_t>(loop_t::getHash()), 0x5575b9adf369bdd9U},
    {"odometry_t", static_cast<std::uint64_t>(odometry_t::getHash()), 0x5cc85c45a6eca696U},
    {"pose_t", static_cast<std::uint64_t>(pose_t::getHash()), 0x5a79275c8350bfaeU},
    {"reply_t", static_cast<std::uint64_t>(reply_t::getHash()), 0x7007421b416eccb2U},
    {"scan_t", static_cast<std::uint64_t>(scan_t::getHash()), 0x4fa9a8e96f9a9d90U},
    {"sensor_health_t", static_cast<std::uint64_t>(sensor_health_t::getHash()), 0x5e8d4d494c7a85a2U},
    {"submap_chunk_t", static_cast<std::uint64_t>(submap_chunk_t::getHash()), 0x837f7a3693a534bcU},
    {"submap_pose_t", static_cast<std::uint64_t>(submap_pose_t::getHash()), 0x54ecbee4cf82ecaeU},
    {"trigger_t", static_cast<std::uint64_t>(trigger_t::getHash()), 0x01848a2e575a842eU},
};

TEST(LcmTypes, FingerprintsAreThoseReleased) {
  for (const Fingerprint& fingerprint : kFingerprints) {
    EXPECT_EQ(fingerprint.hash, fingerprint.released) << fingerprint.type << ": a new field is a new type";
  }
}

}  // namespace
}  // namespace submapd
