// The emulated sensor against the words of the manual and of captures.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/driver_sim/sim_rig.hpp"

namespace submapd::driver::test {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

TEST(SimSensor, HearsNothingWhileItBoots) {
  SimRig rig;
  EXPECT_THAT(rig.ask("VV", 1400.0), IsEmpty());
  rig.boot();
  EXPECT_THAT(rig.ask("VV"), StartsWith("VV\n00P\n"));
}

TEST(SimSensor, SpeaksTheBytesOfTheCapturedUtm30lx) {
  SimRig rig;
  rig.boot();
  EXPECT_EQ(rig.ask("VV"),
            "VV\n00P\nVEND:Hokuyo Automatic Co.,Ltd.;[\nPROD:SOKUIKI Sensor TOP-URG UTM-30LX;P\n"
            "FIRM:P.1.05(17/Apr./2009);M\nPROT:SCIP 2.0;N\nSERI:00903971;:\n\n");
  EXPECT_EQ(rig.ask("PP"),
            "PP\n00P\nMODL:UTM-30LX(Hokuyo Automatic Co.,Ltd.);U\nDMIN:23;7\nDMAX:60000;J\nARES:1440;^\nAMIN:0;?\n"
            "AMAX:1080;Z\nAFRT:540;0\nSCAN:2400;U\n\n");
  EXPECT_THAT(rig.ask("II"), HasSubstr("SCSP:Initial(2400[rpm])<-Default setting by user;1\nMESM:IDLE;"));
  EXPECT_EQ(rig.ask("BM"), "BM\n00P\n\n");
  EXPECT_EQ(rig.ask("BM"), "BM\n02R\n\n");
  EXPECT_EQ(rig.ask("CR00"), "CR00\n04T\n\n");
}

TEST(SimSensor, RefusesWithTheManualsStatuses) {
  SimRig rig;
  rig.boot();
  EXPECT_EQ(rig.ask("XX"), "XX\n0Ee\n\n");
  EXPECT_EQ(rig.ask("SCIP2.0"), "SCIP2.0\n0Ee\n\n");
  EXPECT_EQ(rig.ask("TM1"), "TM1\n04T\n\n");
  EXPECT_EQ(rig.ask("GD0000108001"), "GD0000108001\n10Q\n\n");
  EXPECT_EQ(rig.ask("MD0000108101000"), "MD0000108101000\n04T\n\n");
  EXPECT_EQ(rig.ask("MD0010000901000"), "MD0010000901000\n05U\n\n");
  EXPECT_EQ(rig.ask("MD00"), "MD00\n0Cc\n\n");
  EXPECT_EQ(rig.ask("VV;12345678901234567"), "VV;12345678901234567\n0Gg\n\n");
  EXPECT_EQ(rig.ask("VV;!"), "VV;!\n0Hh\n\n");
}

TEST(SimSensor, StreamsOnItsGridAndCountsDown) {
  SimRig rig;
  rig.boot();
  const std::string heard = rig.ask("MD0000108001003;a1", 200.0);
  EXPECT_THAT(heard, StartsWith("MD0000108001003;a1\n00P\n\nMD0000108001002;a1\n99b\n"));
  EXPECT_THAT(heard, EndsWith("\n\n"));
  EXPECT_EQ(heard.size(), 24U + 3U * (3372U + 3U));
  ASSERT_EQ(rig.truth.size(), 3U);
  EXPECT_EQ(rig.truth[1].first_beam_ns - rig.truth[0].first_beam_ns, 25'000'000);
  EXPECT_EQ(rig.truth[1].stamp_ms - rig.truth[0].stamp_ms, 25U);
  // The laser is out after the last scan.
  EXPECT_EQ(rig.ask("BM"), "BM\n00P\n\n");
}

TEST(SimSensor, ScanLengthsAreThoseOfTheWire) {
  for (const auto& [command, bytes] :
       {std::pair{"MS0000108001001", 2257U}, {"MD0000108001001", 3372U}, {"ME0000108001001", 6717U}}) {
    SimRig rig;
    rig.boot();
    EXPECT_EQ(rig.ask(command, 100.0).size(), 21U + bytes) << command;
  }
}

TEST(SimSensor, QuitEndsTheStreamAndASecondKindIsTakenAfterIt) {
  SimRig rig;
  rig.boot();
  rig.ask("MD0000108001000", 300.0);
  EXPECT_THAT(rig.ask("QT"), EndsWith("QT\n00P\n\n"));
  EXPECT_EQ(rig.ask("VV").find("MD"), std::string::npos);
}

TEST(SimSensor, TimeModeAnswersAtOnceAndRefusesTheRest) {
  SimRig rig;
  rig.boot();
  EXPECT_EQ(rig.ask("TM0"), "TM0\n00P\n\n");
  EXPECT_EQ(rig.ask("TM0", 1.0), "TM0\n02R\n\n");
  const std::string reply = rig.ask("TM1", 0.5);
  EXPECT_THAT(reply, StartsWith("TM1\n00P\n"));
  EXPECT_EQ(reply.size(), 8U + 6U + 1U);
  EXPECT_EQ(rig.ask("MD0000108001000", 1.0), "MD0000108001000\n0Ee\n\n");
  EXPECT_EQ(rig.ask("TM2", 1.0), "TM2\n00P\n\n");
  EXPECT_EQ(rig.ask("TM2"), "TM2\n03S\n\n");
}

TEST(SimSensor, ClockRunsByItsCrystalWrapsAndRestarts) {
  SimSensorOptions options;
  options.clock_ppm = 200.0;
  options.clock_start_ms = 0xFFFFFF;
  SimRig rig(options);
  EXPECT_EQ(rig.sensor.device_ms(0), 0xFFFFFFU);
  EXPECT_EQ(rig.sensor.device_ms(1'000'000), 0U);
  EXPECT_EQ(rig.sensor.device_ms(1000 * std::int64_t{1'000'000'000}), 1'000'199U);
  rig.boot();
  rig.ask("RS", 60.0);
  EXPECT_LT(rig.sensor.device_ms(rig.now_ns), 60U);
}

TEST(SimSensor, StampMayPrecedeTheFirstBeam) {
  SimSensorOptions options;
  options.stamp_to_step0_ns = 3'125'000;
  SimRig rig(options);
  rig.boot();
  rig.ask("MD0000108001001", 100.0);
  ASSERT_EQ(rig.truth.size(), 1U);
  EXPECT_EQ(rig.truth[0].stamp_ms, rig.sensor.device_ms(rig.truth[0].first_beam_ns - 3'125'000));
}

TEST(SimSensor, ClusterTakesTheNearestDistanceAndNeverACodeBesideOne) {
  SimRig rig;
  rig.boot();
  rig.ask("MD0000107904001", 100.0);
  ASSERT_EQ(rig.truth.size(), 1U);
  const std::uint64_t rotation = rig.truth[0].rotation;
  std::vector<std::uint32_t> expected;
  for (std::size_t i = 0; i < 1080; i += 4) {
    std::uint32_t least = 1U << 30;
    for (std::size_t k = i; k < i + 3; ++k) {  // the fourth is a code
      least = std::min(least, static_cast<std::uint32_t>(500 + (k * 7 + rotation * 13) % 20000));
    }
    expected.push_back(least);
  }
  EXPECT_EQ(rig.truth[0].ranges_hash, hash_ranges(expected));
}

TEST(SimSensor, Scip11IsLeftBySayingSo) {
  SimSensorOptions options;
  options.scip11 = true;
  SimRig rig(options);
  rig.boot();
  EXPECT_EQ(rig.ask("QT"), "QT\nE\n\n");
  EXPECT_THAT(rig.ask("V"), HasSubstr("PROT:00003,(SCIP 1.0)"));
  EXPECT_EQ(rig.ask("SCIP2.0"), "SCIP2.0\n0\n\n");
  EXPECT_EQ(rig.ask("QT"), "QT\n00P\n\n");
}

TEST(SimSensor, RehearsesFaultsWithDb) {
  SimRig rig;
  rig.boot();
  EXPECT_EQ(rig.ask("DB03"), "DB03\n00P\n\n");
  const std::string checked = rig.ask("MD0000108001000", 1000.0);
  EXPECT_EQ(occurrences(checked, "\n21S\n"), 5U);
  EXPECT_EQ(occurrences(checked, "\n98a\n"), 1U);
  EXPECT_THAT(checked.substr(checked.find("\n98a\n")), HasSubstr("\n99b\n"));
  rig.ask("QT");
  rig.ask("DB05");
  const std::string ended = rig.ask("MD0000108001000", 1000.0);
  EXPECT_THAT(ended, EndsWith("\n51V\n\n"));
  EXPECT_THAT(rig.ask("II"), HasSubstr("STAT:Trouble!! Error No. =[00->33]"));
  rig.ask("RS");
  EXPECT_THAT(rig.ask("II"), HasSubstr("STAT:Sensor works well."));
}

TEST(SimSensor, BusFramesSpreadAScanOverThreeMilliseconds) {
  SimSensorOptions options;
  options.usb_frame_ns = 1'000'000;
  SimRig rig(options);
  rig.boot();
  rig.ask("MD0000108001001", 100.0);
  const std::int64_t ready_ns = rig.truth[0].first_beam_ns + 19'750'000;
  EXPECT_EQ(rig.last_due_ns % 1'000'000, 0);
  EXPECT_GE(rig.last_due_ns, ready_ns + 2'000'000);
  EXPECT_LE(rig.last_due_ns, ready_ns + 3'000'000);
}

TEST(SimSensor, SameSeedSameBytes) {
  const auto run = [](std::uint64_t seed) {
    SimSensorOptions options;
    options.seed = seed;
    options.fault_rate = 0.3;
    SimRig rig(options);
    rig.boot();
    return rig.ask("MD0000108001000", 2000.0);
  };
  EXPECT_EQ(run(1), run(1));
  EXPECT_NE(run(1), run(2));
}

}  // namespace
}  // namespace submapd::driver::test
