// Requests as they are meant, and what is said about all others.
#include "daemon/control_protocol.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "daemon/map_folder.hpp"

namespace submapd {
namespace {

using nlohmann::json;
using testing::HasSubstr;

std::string error_of(const std::string& packet) {
  const Expected<ControlRequest> request = parse_request(packet);
  if (request) return "";
  EXPECT_EQ(request.error().code(), StatusCode::kInvalidArgument);
  return request.error().message();
}

TEST(ControlProtocolTest, EveryKeyIsTaken) {
  const Expected<ControlRequest> save =
      parse_request(R"({"verb":"save-map","id":"a b","name":"hall.1-x","wait":true,"force":true})");
  ASSERT_TRUE(save.has_value()) << save.error().message();
  EXPECT_EQ(save->verb, ControlVerb::kSaveMap);
  EXPECT_EQ(save->id, "a b");
  EXPECT_EQ(save->name, "hall.1-x");
  EXPECT_TRUE(save->wait);
  EXPECT_TRUE(save->force);
  const Expected<ControlRequest> mark = parse_request(R"({"verb":"mark","name":"_1","utime_us":-9223372036854775808})");
  ASSERT_TRUE(mark.has_value()) << mark.error().message();
  EXPECT_EQ(mark->verb, ControlVerb::kMark);
  EXPECT_EQ(mark->utime_us, INT64_MIN);
  EXPECT_EQ(parse_request(R"({"verb":"status"})")->verb, ControlVerb::kStatus);
  EXPECT_EQ(parse_request(R"({"verb":"health"})")->verb, ControlVerb::kHealth);
  EXPECT_EQ(parse_request(R"({"verb":"pause"})")->verb, ControlVerb::kPause);
  EXPECT_EQ(parse_request(R"({"verb":"resume"})")->verb, ControlVerb::kResume);
  EXPECT_EQ(parse_request(R"({"verb":"new-run"})")->verb, ControlVerb::kNewRun);
}

TEST(ControlProtocolTest, AnythingElseIsRefusedInWords) {
  for (const std::string& packet :
       {std::string(), std::string("{"), std::string("[]"), std::string("1"), std::string("{\"verb\":\"status\"} x"),
        std::string(3000, '['), std::string("\0\xff", 2)}) {
    EXPECT_THAT(error_of(packet), HasSubstr("JSON object"));
  }
  EXPECT_THAT(error_of("{}"), HasSubstr("verb"));
  EXPECT_THAT(error_of(R"({"verb":"reboot"})"), HasSubstr("save-map"));
  EXPECT_THAT(error_of(R"({"verb":1})"), HasSubstr("key"));
  EXPECT_THAT(error_of(R"({"verb":"status","more":1})"), HasSubstr("key"));
  EXPECT_THAT(error_of(R"({"verb":"mark","name":"a","utime_us":1.5})"), HasSubstr("key"));
  EXPECT_THAT(error_of(R"({"verb":"mark","name":"a","utime_us":9223372036854775808})"), HasSubstr("key"));
  EXPECT_THAT(error_of(R"({"verb":"mark"})"), HasSubstr("name"));
  EXPECT_THAT(error_of(R"({"verb":"status","id":")" + std::string(65, 'x') + "\"}"), HasSubstr("id"));
  EXPECT_THAT(error_of(std::string(kMaxRequestBytes + 1, ' ')), HasSubstr("4096"));
}

TEST(ControlProtocolTest, NamesCannotLeaveTheirFolder) {
  for (const char* const good : {"a", "_", "9", "map-20260101-120000", "A.b_c-d"}) EXPECT_TRUE(is_name(good)) << good;
  EXPECT_TRUE(is_name(std::string(64, 'x')));
  for (const char* const bad : {"", ".", "..", ".hidden", "-x", "a/b", "a b", "a\n", "\xc3\xa4", "a\\b"}) {
    EXPECT_FALSE(is_name(bad)) << bad;
  }
  EXPECT_FALSE(is_name(std::string(65, 'x')));
  EXPECT_THAT(error_of(R"({"verb":"save-map","name":"../x"})"), HasSubstr("name"));
}

TEST(ControlProtocolTest, RepliesSayWhatTheAskersExitCodeIs) {
  EXPECT_EQ(json::parse(encode_reply({"7", ReplyState::kWorking, "x", StatusCode::kOk, {{"progress", 5}}})),
            (json{{"id", "7"}, {"state", "working"}, {"message", "x"}, {"progress", 5}}));
  EXPECT_EQ(json::parse(encode_reply(refusal("", {StatusCode::kInvalidArgument, ""})))["reason"], "input");
  EXPECT_EQ(json::parse(encode_reply(refusal("", {StatusCode::kUnavailable, ""})))["reason"], "later");
  EXPECT_EQ(json::parse(encode_reply(refusal("", {StatusCode::kIo, ""})))["reason"], "failed");
  EXPECT_FALSE(json::parse(encode_reply(refusal("\xff", {StatusCode::kIo, "\xc3"})), nullptr, false).is_discarded());
}

}  // namespace
}  // namespace submapd
