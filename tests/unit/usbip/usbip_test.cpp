// The USB/IP front's messages and conversation, byte by byte, in virtual time.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cerrno>
#include <optional>
#include <string>

#include "tests/support/usbip_client.hpp"
#include "tests/unit/driver_sim/sim_rig.hpp"
#include "tools/hokuyo_sim/usbip_session.hpp"

namespace submapd::tools::test {
namespace {

using testing::HasSubstr;

constexpr std::int64_t kMillisecond_ns = 1'000'000;
constexpr std::uint32_t kBulkIn = 1;
constexpr std::uint32_t kBulkOut = 2;
constexpr std::uint32_t kInterruptIn = 3;

std::uint32_t word(const Bytes& bytes, std::size_t at) {
  return std::uint32_t{bytes.at(at)} << 24 | std::uint32_t{bytes.at(at + 1)} << 16 |
         std::uint32_t{bytes.at(at + 2)} << 8 | bytes.at(at + 3);
}

struct Reply {
  std::uint32_t command = 0;
  std::uint32_t seqnum = 0;
  int status = 0;
  std::uint32_t length = 0;
  std::string data;
};

// One scanner that is up, and one client.
class UsbipRig {
 public:
  explicit UsbipRig(const char* script = nullptr) : sensor(options_with(script), driver::test::turning_ranges(), {}) {
    exports_.emplace_back(UsbipDeviceInfo{"1-1", 1, 2, {}}, sensor);
    session.emplace(exports_);
    sensor.power_on(0);
    wait_ms(100);
  }

  static driver::SimSensorOptions options_with(const char* script) {
    driver::SimSensorOptions options;
    options.boot_ns = 0;
    if (script != nullptr) {
      options.script = {*driver::parse_sim_fault(script)};
    }
    return options;
  }

  bool send(const Bytes& bytes) { return session->receive(now_ns_, bytes); }
  void wait_ms(int ms) {
    for (int i = 0; i < ms; ++i) {
      now_ns_ += kMillisecond_ns;
      exports_[0].serve(now_ns_);
    }
  }
  Bytes answer() { return std::exchange(session->output(), {}); }
  void import() {
    ASSERT_TRUE(send(ask_import("1-1")));
    ASSERT_EQ(answer().size(), 8U + 312U);
  }
  // All answers to URBs so far. `with_data`: sequence numbers of URBs to the host.
  std::vector<Reply> replies(std::initializer_list<std::uint32_t> with_data) {
    std::vector<Reply> all;
    const Bytes bytes = answer();
    for (std::size_t at = 0; at < bytes.size();) {
      Reply reply{word(bytes, at), word(bytes, at + 4), static_cast<int>(word(bytes, at + 20)), word(bytes, at + 24),
                  ""};
      at += 48;
      if (std::find(with_data.begin(), with_data.end(), reply.seqnum) != with_data.end()) {
        reply.data.assign(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                          bytes.begin() + static_cast<std::ptrdiff_t>(at + reply.length));
        at += reply.length;
      }
      all.push_back(reply);
    }
    return all;
  }
  Reply control(std::uint32_t seqnum, const Setup& setup) {
    const bool in = (setup[0] & 0x80U) != 0;
    send(submit(seqnum, in, 0, in ? setup[6] : 0U, setup));
    const auto all = in ? replies({seqnum}) : replies({});
    EXPECT_EQ(all.size(), 1U);
    return all.empty() ? Reply{} : all[0];
  }

  driver::SimSensor sensor;

 private:
  std::vector<UsbipExport> exports_;
  std::int64_t now_ns_ = 0;

 public:
  std::optional<UsbipSession> session;
  std::span<UsbipExport> exports() { return exports_; }
};

TEST(Usbip, TheListOfDevicesHasItsBytesInOrder) {
  UsbipRig rig;
  ASSERT_TRUE(rig.send(ask_devlist()));
  const Bytes list = rig.answer();
  ASSERT_EQ(list.size(), 12U + 312U + 2U * 4U);
  EXPECT_EQ(Bytes(list.begin(), list.begin() + 12), (Bytes{0x01, 0x11, 0x00, 0x05, 0, 0, 0, 0, 0, 0, 0, 1}));
  const std::string text(list.begin(), list.end());
  EXPECT_THAT(text.substr(12, 256), HasSubstr("/usb1/1-1"));
  EXPECT_EQ(text.substr(268, 4), std::string("1-1\0", 4));
  // Bus 1, address 2, full speed; 15d1:0000, release 1.00; class 2; one configuration, two interfaces.
  EXPECT_EQ(Bytes(list.begin() + 300, list.begin() + 324),
            (Bytes{0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 2, 0x15, 0xd1, 0, 0, 1, 0, 2, 0, 0, 1, 1, 2}));
  EXPECT_EQ(Bytes(list.end() - 8, list.end()), (Bytes{2, 2, 1, 0, 10, 0, 0, 0}));
}

TEST(Usbip, AnImportIsForOneClientAtATime) {
  UsbipRig rig;
  ASSERT_TRUE(rig.send(ask_import("9-9")));
  EXPECT_EQ(rig.answer(), (Bytes{0x01, 0x11, 0x00, 0x03, 0, 0, 0, 1}));
  rig.import();
  UsbipSession second(rig.exports());
  ASSERT_TRUE(second.receive(0, ask_import("1-1")));
  EXPECT_EQ(second.output(), (Bytes{0x01, 0x11, 0x00, 0x03, 0, 0, 0, 1}));
  rig.session.reset();
  ASSERT_TRUE(second.receive(0, ask_import("1-1")));
  EXPECT_EQ(second.output().size(), 8U + 8U + 312U);
}

TEST(Usbip, DescriptorsComeByControlTransfers) {
  UsbipRig rig;
  rig.import();
  const Reply device = rig.control(1, {0x80, 6, 0, 1, 0, 0, 18, 0});
  EXPECT_EQ(device.status, 0);
  EXPECT_EQ(device.data.substr(8, 4), std::string("\xd1\x15\0\0", 4));
  EXPECT_EQ(rig.control(2, {0x80, 6, 0, 2, 0, 0, 9, 0}).data.size(), 9U);
  EXPECT_EQ(rig.control(3, {0x21, 0x22, 3, 0, 0, 0, 0, 0}).status, 0);
  EXPECT_EQ(rig.control(4, {0x80, 0x55, 0, 0, 0, 0, 1, 0}).status, -EPIPE);
}

TEST(Usbip, AReplyWaitsForItsTransferAndAScanEndsOne) {
  UsbipRig rig;
  rig.import();
  ASSERT_TRUE(rig.send(submit(1, true, kBulkIn, 4096)));
  ASSERT_TRUE(rig.send(submit_out(2, kBulkOut, "QT\nMD0000108001001\n")));
  EXPECT_EQ(rig.replies({}).size(), 1U) << "only what was sent is answered so far";
  rig.wait_ms(60);
  ASSERT_TRUE(rig.send(submit(3, true, kBulkIn, 4096)));
  ASSERT_TRUE(rig.send(submit(4, true, kBulkIn, 4096)));
  rig.wait_ms(60);
  const auto all = rig.replies({1, 3, 4});
  ASSERT_EQ(all.size(), 3U);
  EXPECT_EQ(all[0].data, "QT\n00P\n\n");
  EXPECT_EQ(all[2].data.size(), 3372U);
  EXPECT_THAT(all[2].data, HasSubstr("MD0000108001000\n99b\n"));
}

TEST(Usbip, AnUnlinkedTransferNeverGetsAnAnswerOfItsOwn) {
  UsbipRig rig;
  rig.import();
  ASSERT_TRUE(rig.send(submit(1, true, kInterruptIn, 8)));
  ASSERT_TRUE(rig.send(unlink(2, 1)));
  ASSERT_TRUE(rig.send(unlink(3, 1)));
  const auto all = rig.replies({});
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all[0].command, 4U);
  EXPECT_EQ(all[0].status, -ECONNRESET);
  EXPECT_EQ(all[1].status, 0);
}

TEST(Usbip, AStallFailsAllReadsUntilItIsCleared) {
  UsbipRig rig("stall@0");
  rig.import();
  ASSERT_TRUE(rig.send(submit_out(1, kBulkOut, "MD0000108001000\n")));
  for (std::uint32_t seqnum = 2; seqnum < 6; ++seqnum) {
    ASSERT_TRUE(rig.send(submit(seqnum, true, kBulkIn, 4096)));
  }
  rig.wait_ms(100);
  const auto all = rig.replies({2});  // the acknowledgement
  ASSERT_EQ(all.size(), 5U);
  EXPECT_EQ(all[1].status, 0);
  EXPECT_EQ(all[2].status, -EPIPE);
  EXPECT_EQ(all[4].status, -EPIPE);
  EXPECT_EQ(rig.control(6, {0x02, 1, 0, 0, 0x81, 0, 0, 0}).status, 0);
  ASSERT_TRUE(rig.send(submit(7, true, kBulkIn, 4096)));
  rig.wait_ms(60);
  EXPECT_EQ(rig.replies({7}).at(0).status, 0);
}

TEST(Usbip, APulledCableEndsTheConversationAndTheNextOneImportsAgain) {
  UsbipRig rig("unplug@0:0.2");
  rig.import();
  ASSERT_TRUE(rig.send(submit_out(1, kBulkOut, "MD0000108001000\n")));
  rig.wait_ms(100);
  EXPECT_TRUE(rig.session->over());
  rig.session.emplace(rig.exports());
  ASSERT_TRUE(rig.send(ask_import("1-1")));
  EXPECT_EQ(rig.answer().size(), 8U) << "it is not plugged in";
  rig.wait_ms(250);
  rig.import();
}

TEST(Usbip, WhatNobodyFetchesIsBounded) {
  UsbipRig rig;
  rig.import();
  ASSERT_TRUE(rig.send(submit_out(1, kBulkOut, "MD0000108001000\n")));
  rig.wait_ms(10'000);  // 1.3 MB
  rig.answer();
  std::size_t fetched = 0;
  for (std::uint32_t seqnum = 2; seqnum < 600; ++seqnum) {
    ASSERT_TRUE(rig.send(submit(seqnum, true, kBulkIn, 65'536)));
    const auto all = rig.replies({seqnum});
    if (all.empty()) {
      break;
    }
    fetched += all[0].data.size();
  }
  EXPECT_GT(fetched, BulkInQueue::kMostBytes / 2);
  EXPECT_LE(fetched, BulkInQueue::kMostBytes);
}

TEST(Usbip, WhatBreaksTheProtocolIsOneError) {
  const auto error_of = [](bool imported, const Bytes& bytes) {
    UsbipRig rig;
    if (imported) {
      rig.import();
    }
    EXPECT_FALSE(rig.send(bytes));
    EXPECT_FALSE(rig.send(ask_devlist())) << "nothing more is taken";
    EXPECT_TRUE(rig.answer().empty());
    EXPECT_FALSE(words_of(rig.session->error()).empty());
    return rig.session->error();
  };
  const auto with = [](std::size_t offset, std::uint8_t byte) {
    Bytes bytes = submit(1, true, kBulkIn, 64);
    bytes[offset] = byte;
    return bytes;
  };
  EXPECT_EQ(error_of(false, {0x01, 0x06, 0x80, 0x05, 0, 0, 0, 0}), UsbipError::kVersion);
  EXPECT_EQ(error_of(false, {0x01, 0x11, 0x80, 0x06, 0, 0, 0, 0}), UsbipError::kCommand);
  EXPECT_EQ(error_of(true, with(3, 3)), UsbipError::kCommand);
  EXPECT_EQ(error_of(true, with(15, 2)), UsbipError::kDirection);
  EXPECT_EQ(error_of(true, with(24, 0x80)), UsbipError::kTooLong);
  EXPECT_EQ(error_of(true, with(35, 1)), UsbipError::kIsochronous);
  EXPECT_EQ(error_of(true, with(11, 7)), UsbipError::kDevice);
}

TEST(Usbip, TransfersUnderWayAreBounded) {
  UsbipRig rig;
  rig.import();
  for (std::uint32_t seqnum = 0; seqnum < UsbipExport::kMostUrbs; ++seqnum) {
    ASSERT_TRUE(rig.send(submit(seqnum, true, kBulkIn, 64)));
  }
  EXPECT_FALSE(rig.send(submit(1000, true, kBulkIn, 64)));
  EXPECT_EQ(rig.session->error(), UsbipError::kTooManyUrbs);
}

TEST(Usbip, AnyChunkingGivesTheSameAnswers) {
  Bytes bytes = ask_devlist();
  for (const Bytes& more : {ask_import("9-9"), ask_import("1-1"), submit(1, true, 0, 18, {0x80, 6, 0, 1, 0, 0, 18, 0}),
                            submit_out(2, kBulkOut, "VV\n"), submit(3, true, kBulkIn, 512), unlink(4, 3)}) {
    bytes.insert(bytes.end(), more.begin(), more.end());
  }
  UsbipRig whole;
  ASSERT_TRUE(whole.send(bytes));
  for (std::size_t chunk = 1; chunk < 100; ++chunk) {
    UsbipRig cut;
    for (std::size_t at = 0; at < bytes.size(); at += chunk) {
      ASSERT_TRUE(cut.send({bytes.begin() + static_cast<std::ptrdiff_t>(at),
                            bytes.begin() + static_cast<std::ptrdiff_t>(std::min(at + chunk, bytes.size()))}));
    }
    ASSERT_EQ(cut.session->output(), whole.session->output()) << chunk;
  }
}

}  // namespace
}  // namespace submapd::tools::test
