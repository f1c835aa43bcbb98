// Triggers and commands as they come over the network, from anyone.
#include "daemon/lcm_requests.hpp"

#include <gtest/gtest.h>

#include "proto/lcm_message.hpp"
#include "submapd/command_t.hpp"
#include "submapd/reply_t.hpp"
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

TEST(LcmRequestsTest, ATriggerIsAMarkThatNobodyAnswers) {
  const Expected<LcmRequest> request = LcmRequests::decode_trigger(trigger(5, "pano-1"));
  ASSERT_TRUE(request.has_value());
  EXPECT_EQ(request->request.verb, ControlVerb::kMark);
  EXPECT_EQ(request->request.name, "pano-1");
  EXPECT_EQ(request->request.utime_us, 5);
  EXPECT_FALSE(request->command.has_value());
  EXPECT_FALSE(LcmRequests::decode_trigger(trigger(0, "pano-1"))->request.utime_us.has_value()) << "now";
  EXPECT_FALSE(LcmRequests::decode_trigger(trigger(-1, "pano-1")).has_value());
  for (const char* const name : {"", "../x", "a b", "-x"}) {
    EXPECT_FALSE(LcmRequests::decode_trigger(trigger(5, name)).has_value()) << name;
  }
}

TEST(LcmRequestsTest, OnlyFourCommandsAreKnown) {
  const auto verb = [](std::int8_t which, const std::string& name) {
    const Expected<LcmRequest> request = LcmRequests::decode_command(command(which, name));
    EXPECT_TRUE(request && request->status.ok() && request->command) << int{which};
    EXPECT_EQ(request->request.name, name);
    return request->request.verb;
  };
  EXPECT_EQ(verb(command_t::SAVE_MAP, ""), ControlVerb::kSaveMap);
  EXPECT_EQ(verb(command_t::SAVE_MAP, "hall"), ControlVerb::kSaveMap);
  EXPECT_EQ(verb(command_t::PAUSE, ""), ControlVerb::kPause);
  EXPECT_EQ(verb(command_t::RESUME, ""), ControlVerb::kResume);
  EXPECT_EQ(verb(command_t::MARK, "door"), ControlVerb::kMark);
  const auto refused = [](std::int8_t which, const std::string& name) {
    const Expected<LcmRequest> request = LcmRequests::decode_command(command(which, name));
    EXPECT_TRUE(request && request->command) << "it can be answered";
    return request->status.code() == StatusCode::kInvalidArgument && request->request.name.empty();
  };
  EXPECT_TRUE(refused(command_t::MARK, ""));
  EXPECT_TRUE(refused(command_t::SAVE_MAP, "../x"));
  for (const std::int8_t unknown : std::initializer_list<std::int8_t>{-1, 0, 5, 127}) {
    EXPECT_TRUE(refused(unknown, "x")) << int{unknown};
  }
}

TEST(LcmRequestsTest, AReplySaysWhichCommandItAnswersAndHowItWent) {
  const Uuid cart = Uuid::from_seed(1, 1);
  const Uuid run = Uuid::from_seed(1, 2);
  const LcmCommand asked{77, command_t::SAVE_MAP};
  EXPECT_EQ(asked.id(), "lcm-77");
  EXPECT_EQ((LcmCommand{0, command_t::SAVE_MAP}).id(), "") << "no two of those are the same request";
  const auto sent = [&](const ControlReply& reply) {
    const Expected<reply_t> decoded = decode_with_text<reply_t>(encode_command_reply(asked, reply, cart, run, 99));
    EXPECT_TRUE(decoded.has_value());
    return decoded.value_or(reply_t{});
  };
  const reply_t working =
      sent({"lcm-77", ReplyState::kWorking, "saving hall, 30 %", StatusCode::kOk, {{"progress", 30}}});
  EXPECT_EQ(working.utime, 99);
  EXPECT_EQ(get_uuid(working.cart), cart);
  EXPECT_EQ(get_uuid(working.run), run);
  EXPECT_EQ(working.command_utime, 77);
  EXPECT_EQ(working.command, command_t::SAVE_MAP);
  EXPECT_EQ(working.state, reply_t::WORKING);
  EXPECT_EQ(working.reason, reply_t::NONE);
  EXPECT_EQ(working.progress, 30);
  EXPECT_EQ(working.message, "saving hall, 30 %");
  EXPECT_EQ(sent({"", ReplyState::kDone, "paused"}).state, reply_t::DONE);
  EXPECT_EQ(sent(refusal("", {StatusCode::kInvalidArgument, "x"})).reason, reply_t::INPUT);
  EXPECT_EQ(sent(refusal("", {StatusCode::kUnavailable, "x"})).reason, reply_t::LATER);
  EXPECT_EQ(sent(refusal("", {StatusCode::kIo, "x"})).reason, reply_t::OTHER);
  EXPECT_EQ(sent(refusal("", {StatusCode::kIo, "x"})).state, reply_t::FAILED);
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
