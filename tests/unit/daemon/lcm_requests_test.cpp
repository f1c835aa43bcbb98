// Triggers and commands as they come over the network, from anyone.
#include "daemon/lcm_requests.hpp"

#include <gtest/gtest.h>

#include "proto/lcm_message.hpp"
#include "submapd/command_t.hpp"
#include "submapd/trigger_t.hpp"

namespace submapd {
namespace {

std::vector<std::byte> trigger(std::int64_t utime, const std::string& name) {
  trigger_t message{};
  message.utime = utime;
  message.name = name;
  return encode_message(message);
}

std::vector<std::byte> command(std::int8_t which, const std::string& name) {
  command_t message{};
  message.command = which;
  message.name = name;
  return encode_message(message);
}

TEST(LcmRequestsTest, ATriggerIsAMark) {
  const Expected<ControlRequest> request = LcmRequests::decode_trigger(trigger(5, "pano-1"));
  ASSERT_TRUE(request.has_value());
  EXPECT_EQ(request->verb, ControlVerb::kMark);
  EXPECT_EQ(request->name, "pano-1");
  EXPECT_EQ(request->utime_us, 5);
  EXPECT_FALSE(LcmRequests::decode_trigger(trigger(0, "pano-1"))->utime_us.has_value()) << "now";
  EXPECT_FALSE(LcmRequests::decode_trigger(trigger(-1, "pano-1")).has_value());
  for (const char* const name : {"", "../x", "a b", "-x"}) {
    EXPECT_FALSE(LcmRequests::decode_trigger(trigger(5, name)).has_value()) << name;
  }
}

TEST(LcmRequestsTest, OnlyFourCommandsAreKnown) {
  EXPECT_EQ(LcmRequests::decode_command(command(command_t::SAVE_MAP, ""))->verb, ControlVerb::kSaveMap);
  EXPECT_EQ(LcmRequests::decode_command(command(command_t::SAVE_MAP, "hall"))->name, "hall");
  EXPECT_EQ(LcmRequests::decode_command(command(command_t::PAUSE, ""))->verb, ControlVerb::kPause);
  EXPECT_EQ(LcmRequests::decode_command(command(command_t::RESUME, ""))->verb, ControlVerb::kResume);
  EXPECT_FALSE(LcmRequests::decode_command(command(command_t::MARK, "")).has_value());
  EXPECT_FALSE(LcmRequests::decode_command(command(command_t::SAVE_MAP, "../x")).has_value());
  for (const std::int8_t unknown : std::initializer_list<std::int8_t>{-1, 0, 5, 127}) {
    EXPECT_FALSE(LcmRequests::decode_command(command(unknown, "x")).has_value()) << int{unknown};
  }
}

TEST(LcmRequestsTest, EveryCutAndEveryOtherTypeIsRefused) {
  const std::vector<std::byte> whole = trigger(5, "pano-1");
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_FALSE(LcmRequests::decode_trigger(std::span(whole).first(size)).has_value()) << size;
  }
  std::vector<std::byte> longer = whole;
  longer.push_back(std::byte{0});
  EXPECT_FALSE(LcmRequests::decode_trigger(longer).has_value());
  EXPECT_FALSE(LcmRequests::decode_command(whole).has_value());
}

}  // namespace
}  // namespace submapd
