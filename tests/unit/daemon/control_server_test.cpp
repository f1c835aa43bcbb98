// The control socket within its bounds: packets, clients, silence, and sockets that others left.
#include "daemon/control_server.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <thread>
#include <vector>

#include "daemon/control_protocol.hpp"
#include "driver/monotonic.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tools/control/control_client.hpp"

namespace submapd {
namespace {

using nlohmann::json;
using tools::ControlClient;

constexpr std::chrono::milliseconds kPatience{5000};

// A server on a thread of its own that says what it heard, until it hears "stop".
class ControlServerTest : public testing::Test {
 protected:
  void start() {
    options_.path = path();
    Expected<std::unique_ptr<ControlServer>> server = ControlServer::open(
        loop_, options_, [this](std::string_view packet, const ControlPeer& peer) { return answer(packet, peer); });
    ASSERT_TRUE(server.has_value()) << server.error().message();
    server_ = std::move(*server);
    thread_ = std::thread([this] { EXPECT_TRUE(loop_.run().ok()); });
  }
  void TearDown() override {
    if (!thread_.joinable()) return;
    Expected<ControlClient> client = ControlClient::connect(path());
    ASSERT_TRUE(client.has_value());
    ASSERT_TRUE(client->send("stop").ok());
    thread_.join();
  }
  std::string answer(std::string_view packet, const ControlPeer& peer) {
    if (packet == "\"stop\"") {
      loop_.stop();
      return "";
    }
    if (packet == "\"look\"") server_->look(driver::monotonic_now_ns() + 2 * options_.idle_ns);
    if (packet == "\"keep\"") server_->keep(peer.client, true);
    if (packet == "\"twice\"") server_->send(peer.client, encode_reply({"1", ReplyState::kWorking, ""}));
    return encode_reply({"",
                         ReplyState::kDone,
                         std::string(packet),
                         StatusCode::kOk,
                         {{"pid", peer.pid}, {"clients", server_->clients()}}});
  }
  std::string path() { return (folder_.path() / "control").string(); }

  TemporaryFolder folder_;
  ControlServerOptions options_;
  EventLoop loop_;
  std::unique_ptr<ControlServer> server_;
  std::thread thread_;
};

TEST_F(ControlServerTest, AnswersAndKnowsWhoAsks) {
  start();
  Expected<ControlClient> client = ControlClient::connect(path());
  ASSERT_TRUE(client.has_value()) << client.error().message();
  const Expected<json> answer = client->ask("hello");
  ASSERT_TRUE(answer.has_value()) << answer.error().message();
  EXPECT_EQ((*answer)["message"], "\"hello\"");
  EXPECT_EQ((*answer)["pid"], ::getpid());
  ASSERT_TRUE(client->send("twice").ok());
  EXPECT_EQ((*client->receive(kPatience))["state"], "working");
  EXPECT_EQ((*client->receive(kPatience))["state"], "done");
  struct stat info {};
  ASSERT_EQ(::stat(path().c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0660U);
}

TEST_F(ControlServerTest, SilentClientsMakeRoomForTheNext) {
  options_.most_clients = 2;
  options_.patience_ns = 0;
  start();
  Expected<ControlClient> waits = ControlClient::connect(path());
  ASSERT_TRUE(waits.has_value() && waits->ask("keep").has_value());
  Expected<ControlClient> silent = ControlClient::connect(path());
  ASSERT_TRUE(silent.has_value() && silent->ask("hello").has_value());
  Expected<ControlClient> next = ControlClient::connect(path());
  ASSERT_TRUE(next.has_value());
  EXPECT_EQ((*next->ask("hello"))["clients"], 2);
  EXPECT_FALSE(silent->ask("hello").has_value()) << "shut out";
  EXPECT_TRUE(waits->ask("hello").has_value());
}

TEST_F(ControlServerTest, ALongPacketEndsTheConnectionAndNothingElse) {
  start();
  Expected<ControlClient> client = ControlClient::connect(path());
  ASSERT_TRUE(client->send(std::string(2 * kMaxRequestBytes, 'x')).ok());
  EXPECT_EQ((*client->receive(kPatience))["state"], "failed");
  EXPECT_FALSE(client->receive(kPatience).has_value());
  EXPECT_TRUE(ControlClient::connect(path())->ask("still there").has_value());
}

TEST_F(ControlServerTest, MoreClientsThanAllowedAreTurnedAway) {
  options_.most_clients = 3;
  options_.patience_ns = options_.idle_ns;
  start();
  std::vector<ControlClient> clients;
  for (std::size_t i = 0; i < options_.most_clients; ++i) {
    clients.push_back(std::move(*ControlClient::connect(path())));
    ASSERT_TRUE(clients.back().ask("in").has_value());
  }
  for (int i = 0; i < 1000; ++i) {
    Expected<ControlClient> late = ControlClient::connect(path());
    ASSERT_TRUE(late.has_value());
    ASSERT_EQ((*late->receive(kPatience))["reason"], "later");
  }
  EXPECT_EQ((*clients[0].ask("me"))["clients"], options_.most_clients);
  clients.clear();
}

TEST_F(ControlServerTest, TheIdleAreShutOutAndWhoWaitsIsNot) {
  start();
  Expected<ControlClient> idle = ControlClient::connect(path());
  Expected<ControlClient> waits = ControlClient::connect(path());
  ASSERT_TRUE(idle->ask("in").has_value());
  ASSERT_TRUE(waits->ask("keep").has_value());
  EXPECT_EQ((*waits->ask("look"))["clients"], 1U);
  EXPECT_FALSE(idle->receive(kPatience).has_value());
}

TEST_F(ControlServerTest, WhatLiesInTheWayIsJudged) {
  start();
  EventLoop loop;
  const auto open = [&](const ControlServerOptions& options) {
    return ControlServer::open(loop, options, [](std::string_view, const ControlPeer&) { return std::string(); });
  };
  const auto second = open(options_);
  ASSERT_FALSE(second.has_value());
  EXPECT_EQ(second.error().code(), StatusCode::kUnavailable) << "another daemon answers there";

  ControlServerOptions other = options_;
  other.path = (folder_.path() / "file").string();
  std::ofstream(other.path) << "precious";
  EXPECT_FALSE(open(other).has_value());
  EXPECT_TRUE(std::filesystem::exists(other.path));

  other.path = (folder_.path() / "stale").string();
  ASSERT_EQ(std::system(("python3 -c \"import socket; socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET).bind('" +
                         other.path + "')\"")
                            .c_str()),
            0);
  EXPECT_TRUE(open(other).has_value()) << "nobody answers there any more";

  other.path = (folder_.path() / "grouped").string();
  other.group = "no-such-group";
  const auto grouped = open(other);
  ASSERT_FALSE(grouped.has_value());
  EXPECT_THAT(grouped.error().message(), testing::HasSubstr("no-such-group"));
}

}  // namespace
}  // namespace submapd
