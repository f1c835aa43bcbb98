#include "slam/base/ids.hpp"

#include <gtest/gtest.h>

#include <set>

namespace submapd {
namespace {

TEST(UuidTest, PrintsInRfc4122Form) {
  EXPECT_EQ(Uuid{}.to_string(), "00000000-0000-0000-0000-000000000000");
  Uuid uuid;
  for (std::size_t i = 0; i < uuid.bytes.size(); ++i) uuid.bytes[i] = static_cast<std::uint8_t>(0x11 * i);
  EXPECT_EQ(uuid.to_string(), "00112233-4455-6677-8899-aabbccddeeff");
}

TEST(UuidTest, FromSeedIsPinned) {
  // From a separate implementation in Python, as in random_test.cpp: replays are named after it.
  EXPECT_EQ(Uuid::from_seed(1, 0).to_string(), "ed660ccc-c78f-4b3f-bc9b-9dc17fbfb7c9");
}

TEST(UuidTest, FromSeedIsVersion4ShapedAndUnique) {
  std::set<Uuid> seen;
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    for (std::uint64_t stream = 0; stream < 50; ++stream) {
      const Uuid uuid = Uuid::from_seed(seed, stream);
      EXPECT_EQ(uuid.bytes[6] >> 4, 4);
      EXPECT_EQ(uuid.bytes[8] >> 6, 2);
      EXPECT_EQ(uuid, Uuid::from_seed(seed, stream));
      seen.insert(uuid);
    }
  }
  EXPECT_EQ(seen.size(), 2500U);
}

TEST(SubmapIdTest, OrdersByCartThenRunThenIndex) {
  const Uuid low = Uuid{};
  Uuid high;
  high.bytes[0] = 1;
  EXPECT_LT((SubmapId{low, high, 9}), (SubmapId{high, low, 0}));
  EXPECT_LT((SubmapId{low, low, 9}), (SubmapId{low, high, 0}));
  EXPECT_LT((SubmapId{low, low, 8}), (SubmapId{low, low, 9}));
  EXPECT_EQ((SubmapId{low, high, 3}), (SubmapId{low, high, 3}));
}

}  // namespace
}  // namespace submapd
