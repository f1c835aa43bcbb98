// Scripted misbehaviour: the script's language, and that each fault does what its name says and no more.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/driver_sim/sim_rig.hpp"

namespace submapd::driver::test {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr const char* kStart = "MD0000108001000";
constexpr std::size_t kScanBytes = 3372;

SimRig started(const std::string& script, double ms = 1000.0) {
  SimSensorOptions options;
  const auto fault = parse_sim_fault(script);
  EXPECT_TRUE(fault.has_value()) << (fault ? "" : fault.error());
  options.script = {*fault};
  SimRig rig(options);
  rig.boot();
  rig.ask(kStart, ms);
  return rig;
}

std::size_t hit(const SimRig& rig) {
  std::size_t n = 0;
  for (const SimScanTruth& scan : rig.truth) {
    n += scan.faults != 0 ? 1U : 0U;
  }
  return n;
}

TEST(SimFaultScript, ReadsKindsTimesAndArguments) {
  const auto silence = parse_sim_fault("silence@2.5:0.4");
  ASSERT_TRUE(silence.has_value());
  EXPECT_EQ(silence->kind, SimFaultKind::kSilence);
  EXPECT_EQ(silence->at_ns, 2'500'000'000);
  EXPECT_EQ(silence->duration_ns, 400'000'000);
  EXPECT_EQ(parse_sim_fault("garbled-sum@1:7")->count, 7U);
  EXPECT_EQ(parse_sim_fault("hang@1:reset")->remedy, SimRemedy::kUsbReset);
  EXPECT_EQ(name_of(SimFaultKind::kTrouble), "trouble");
  EXPECT_EQ(name_of(SimFaultKind::kGarbledSum), "garbled-sum");
}

TEST(SimFaultScript, NamesWhatItDoesNotKnow) {
  EXPECT_THAT(parse_sim_fault("sulk@1").error(), HasSubstr("silence"));
  EXPECT_THAT(parse_sim_fault("stall").error(), HasSubstr("KIND@SECONDS"));
  for (const char* bad : {"stall@1:2", "stall@x", "stall@-1", "skip@1:0", "hang@1:prayer", "silence@1:", "", "@"}) {
    EXPECT_FALSE(parse_sim_fault(bad).has_value()) << bad;
  }
}

TEST(SimFault, EveryDamageHitsExactlyTheScansAsked) {
  for (const char* kind : {"garbled-sum", "bad-character", "damaged-bytes", "lost-packet", "lost-line",
                           "doubled-packet", "doubled-line", "cut", "garbage"}) {
    SimRig clean = started("silence@1000");
    SimRig rig = started(std::string(kind) + "@0.2:3");
    EXPECT_EQ(hit(rig), 3U) << kind;
    EXPECT_NE(rig.heard, clean.heard) << kind;
    EXPECT_EQ(rig.truth.size(), clean.truth.size()) << kind;
    // Before and after the damage every byte is as it would have been.
    EXPECT_EQ(rig.heard.substr(0, 7 * kScanBytes), clean.heard.substr(0, 7 * kScanBytes)) << kind;
    EXPECT_EQ(rig.heard.substr(rig.heard.size() - 20 * kScanBytes),
              clean.heard.substr(clean.heard.size() - 20 * kScanBytes))
        << kind;
  }
}

TEST(SimFault, BusFaultsComeInTheMiddleOfAScan) {
  const SimRig stall = started("stall@0.2");
  EXPECT_EQ(occurrences(stall.heard, "<stall>"), 1U);
  const std::size_t at = stall.heard.find("<stall>");
  EXPECT_NE(stall.heard.substr(at - 2, 2), "\n\n");
  const SimRig unplug = started("unplug@0.2:0.3");
  EXPECT_EQ(occurrences(unplug.heard, "<unplug><replug>"), 1U);
  // It streams on, unheard, while it is away.
  EXPECT_EQ(unplug.truth.size(), stall.truth.size());
}

TEST(SimFault, SkippedScansAreMeasuredButNotSent) {
  const SimRig rig = started("skip@0.2:2");
  EXPECT_EQ(occurrences(rig.heard, "\n99b\n") + 2U, rig.truth.size());
  EXPECT_EQ(occurrences(started("repeat@0.2:2").heard, "\n99b\n"), rig.truth.size() + 2U);
}

TEST(SimFault, HangEndsWithItsRemedyAndNoLesser) {
  SimRig md = started("hang@0.2:md");
  EXPECT_THAT(md.ask("VV"), HasSubstr("SERI"));
  EXPECT_THAT(md.ask(kStart, 200.0), HasSubstr("\n99b\n"));

  SimRig qt = started("hang@0.2:qt");
  EXPECT_THAT(qt.ask(kStart), IsEmpty());
  EXPECT_EQ(qt.ask("QT"), "QT\n00P\n\n");
  EXPECT_THAT(qt.ask(kStart, 200.0), HasSubstr("\n99b\n"));

  SimRig rs = started("hang@0.2:rs");
  EXPECT_THAT(rs.ask("QT"), IsEmpty());
  EXPECT_EQ(rs.ask("RS"), "RS\n00P\n\n");

  SimRig reset = started("hang@0.2:reset");
  EXPECT_THAT(reset.ask("RS"), IsEmpty());
  reset.sensor.usb_reset(reset.now_ns);
  EXPECT_THAT(reset.ask("VV"), HasSubstr("SERI"));
}

TEST(SimFault, BrownOutRestartsTheClockAndForgetsTheStream) {
  SimRig rig = started("brown-out@0.2", 1000.0);
  EXPECT_THAT(rig.ask("VV", 100.0), IsEmpty());
  rig.wait_ms(1500.0);
  EXPECT_THAT(rig.ask("VV"), HasSubstr("SERI"));
  EXPECT_LT(rig.sensor.device_ms(rig.now_ns), 2600U);
  rig.ask(kStart, 200.0);
  EXPECT_EQ(rig.truth.back().epoch, 1U);
}

TEST(SimFault, AbnormalRefusesAllButQuestions) {
  SimRig rig = started("abnormal@0.2");
  EXPECT_EQ(rig.ask("QT"), "QT\n0Ll\n\n");
  EXPECT_EQ(rig.ask("RS"), "RS\n0Ll\n\n");
  EXPECT_THAT(rig.ask("II"), HasSubstr("STAT:Abnormal"));
}

TEST(SimFault, RandomFaultsComeAtTheirRate) {
  SimSensorOptions options;
  options.fault_rate = 0.2;
  options.damage_rate = 0.1;
  SimRig rig(options);
  rig.boot();
  rig.ask(kStart, 100'000.0);
  const double share = static_cast<double>(hit(rig)) / static_cast<double>(rig.truth.size());
  EXPECT_NEAR(share, 0.2 + 0.8 * 0.1, 0.03);  // five sigma of 4000 scans
}

}  // namespace
}  // namespace submapd::driver::test
