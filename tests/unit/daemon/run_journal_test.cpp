// The journal's records come back as they were; cuts lose the last record only; damage is told.
#include "daemon/run_journal.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "tests/support/temporary_folder.hpp"

namespace submapd {
namespace {

const Uuid kCart = Uuid::from_seed(3, 1);
const Uuid kRun = Uuid::from_seed(3, 2);

std::vector<JournalRecord> one_of_each() {
  Sha256 hash{};
  hash[0] = 1;
  hash[31] = 255;
  return {{1, RunStarted{-5, "0.1.0"}},
          {2, SubmapSaved{7, hash}},
          {3, MarkSet{-9, "door"}},
          {4, MapSaved{"hall.1"}},
          {5, ScansShed{1, 1ULL << 63}},
          {6, RunEnded{}},
          {7, RunPaused{}},
          {8, RunResumed{}},
          {9, RunContinued{7, "0.2.0"}},
          {10, ClockStepped{-36}},
          {11, InputIs{"usb"}},
          {12, LandmarksAdded{{1, 7, 0.02, {{{1.5, -2.0}, {0.25, 3.0}}, {{4.0, 5.0}, {6.0, -7.0}}}}}},
          {13, PairRemoved{2, 9}},
          {14, PairForbidden{3, 8}},
          {15, EditUndone{}}};
}

std::vector<std::byte> encode(const std::vector<JournalRecord>& records) {
  return encode_journal(kCart, kRun, records);
}

TEST(RunJournalTest, EveryRecordComesBack) {
  const std::vector<std::byte> bytes = encode(one_of_each());
  const Expected<JournalContents> contents = decode_journal(bytes);
  ASSERT_TRUE(contents.has_value()) << contents.error().message();
  EXPECT_EQ(contents->cart, kCart);
  EXPECT_EQ(contents->run, kRun);
  EXPECT_EQ(contents->records, one_of_each());
  EXPECT_EQ(contents->whole_bytes, bytes.size());
}

TEST(RunJournalTest, ACutLosesTheLastRecordOnly) {
  const std::vector<JournalRecord> records = one_of_each();
  const std::vector<std::byte> bytes = encode(records);
  const std::size_t header = encode({}).size();
  for (std::size_t size = 0; size <= bytes.size(); ++size) {
    const Expected<JournalContents> contents = decode_journal(std::span(bytes).first(size));
    ASSERT_EQ(contents.has_value(), size >= header) << size;
    if (!contents) continue;
    std::vector<JournalRecord> whole = records;
    while (encode(whole).size() > size) whole.pop_back();
    EXPECT_EQ(contents->records, whole) << size;
    EXPECT_EQ(contents->whole_bytes, encode(whole).size());
  }
}

TEST(RunJournalTest, DamageIsTold) {
  const std::vector<JournalRecord> records = one_of_each();
  const std::size_t last = encode({records.begin(), records.end() - 1}).size();
  const std::vector<std::byte> bytes = encode(records);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    std::vector<std::byte> damaged = bytes;
    damaged[i] ^= std::byte{0x10};
    const Expected<JournalContents> contents = decode_journal(damaged);
    if (i < last && contents) {
      // A length that reaches beyond the end looks like a cut.
      EXPECT_LT(contents->records.size(), records.size()) << i;
    } else if (contents) {
      EXPECT_EQ(contents->records.size(), records.size() - 1) << i;
    }
  }
}

TEST(RunJournalTest, TheFileHoldsWhatWasAppended) {
  const TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "journal";
  {
    Expected<std::unique_ptr<RunJournal>> journal = RunJournal::create(path, kCart, kRun);
    ASSERT_TRUE(journal.has_value()) << journal.error().message();
    for (const JournalRecord& record : one_of_each()) ASSERT_TRUE((*journal)->append(record).ok());
  }
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  const auto bytes = std::as_bytes(std::span(text));
  EXPECT_EQ(std::vector<std::byte>(bytes.begin(), bytes.end()), encode(one_of_each()));
  EXPECT_FALSE(RunJournal::create(path, kCart, kRun).has_value()) << "a journal is never overwritten";
}

TEST(RunJournalTest, ReopenedItGoesOnBehindTheLastWholeRecord) {
  const TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "journal";
  std::vector<std::byte> bytes = encode({{1, RunStarted{}}, {2, MarkSet{3, "door"}}});
  bytes.resize(bytes.size() - 3);
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  const Expected<JournalContents> cut = read_journal(path);
  ASSERT_TRUE(cut.has_value()) << cut.error().message();
  {
    Expected<std::unique_ptr<RunJournal>> journal = RunJournal::reopen(path, *cut);
    ASSERT_TRUE(journal.has_value()) << journal.error().message();
    ASSERT_TRUE((*journal)->append({4, RunContinued{5, "x"}}).ok());
  }
  const Expected<JournalContents> contents = read_journal(path);
  ASSERT_TRUE(contents.has_value()) << contents.error().message();
  EXPECT_EQ(contents->records, (std::vector<JournalRecord>{{1, RunStarted{}}, {4, RunContinued{5, "x"}}}));
}

TEST(RunJournalTest, TheFirstVersionIsRead) {
  std::vector<std::byte> bytes = encode_journal_header(kCart, kRun, 1);
  const std::size_t header = bytes.size();
  for (const JournalRecord& record : {JournalRecord{1, RunEnded{}}, JournalRecord{2, InputIs{"usb"}}}) {
    const std::vector<std::byte> more = encode_journal_record(record);
    bytes.insert(bytes.end(), more.begin(), more.end());
  }
  const Expected<JournalContents> contents = decode_journal(bytes);
  ASSERT_TRUE(contents.has_value());
  EXPECT_EQ(contents->version, 1U);
  EXPECT_EQ(contents->records.size(), 1U) << "it had no such type: as if damaged";
  bytes = encode_journal_header(kCart, kRun, kJournalVersion + 1);
  EXPECT_EQ(bytes.size(), header);
  EXPECT_EQ(decode_journal(bytes).error().code(), StatusCode::kCorrupt);
}

TEST(RunJournalTest, TheSecondVersionIsReadAndHasNoEdits) {
  std::vector<std::byte> bytes = encode_journal_header(kCart, kRun, 2);
  for (const JournalRecord& record : {JournalRecord{1, InputIs{"usb"}}, JournalRecord{2, EditUndone{}}}) {
    const std::vector<std::byte> more = encode_journal_record(record);
    bytes.insert(bytes.end(), more.begin(), more.end());
  }
  const Expected<JournalContents> contents = decode_journal(bytes);
  ASSERT_TRUE(contents.has_value());
  EXPECT_EQ(contents->records, (std::vector<JournalRecord>{{1, InputIs{"usb"}}}));
}

}  // namespace
}  // namespace submapd
