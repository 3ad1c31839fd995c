#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "realtime/base/bytes/crc32.hpp"
#include "realtime/base/bytes/packed_numbers.hpp"
#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/kernel/rings/fixed_queue.hpp"

namespace fathom::rt {
namespace {

enum class Colour : std::uint8_t { kRed, kGreen, kBlue };

struct Inner {
  double x = 0;
  bool known = false;

  static void exchange(auto& archive, auto& self) { archive(self.x, self.known); }
  friend bool operator==(const Inner&, const Inner&) = default;
};

struct Everything {
  std::int32_t number = 0;
  float real = 0;
  bool flag = false;
  Colour colour = Colour::kRed;
  std::string text;
  std::array<std::uint16_t, 3> three{};
  std::vector<Inner> list;
  std::vector<std::uint64_t> pool = std::vector<std::uint64_t>(5);
  std::optional<Inner> maybe, never;
  std::map<int, std::string> names;
  std::set<std::pair<int, int>> pairs;
  FixedQueue<Inner, 3> queue;

  static void exchange(auto& archive, auto& self) {
    archive(self.number, self.real, self.flag);
    archive.enumeration(self.colour, Colour::kBlue);
    archive(self.text, self.three);
    archive.bounded(self.list, 4);
    archive.fixed(self.pool);
    archive(self.maybe, self.never, self.names, self.pairs, self.queue);
  }
};

Everything sample() {
  Everything e{.number = -7,
               .real = 0.1F,
               .flag = true,
               .colour = Colour::kGreen,
               .text = "reef",
               .three = {1, 2, 65535},
               .list = {{1.5, true}, {std::numeric_limits<double>::infinity(), false}},
               .pool = {1, 2, 3, 4, 1ULL << 63},
               .maybe = Inner{-0.0, true},
               .never = std::nullopt,
               .names = {{1, "one"}, {-2, ""}},
               .pairs = {{1, 2}, {1, 3}, {-5, 0}},
               .queue = {}};
  for (int i = 0; i < 5; ++i) e.queue.pushDroppingOldest({i / 3.0, i % 2 == 0});
  (void)e.queue.push({});
  return e;
}

constexpr std::uint32_t kTag = stateTag("TEST");

std::vector<std::uint8_t> saved(const Everything& e) {
  std::vector<std::uint8_t> buffer(4096);
  StateWriter writer(buffer);
  writer.section(kTag, 3, [&] { writer(e); });
  EXPECT_FALSE(writer.full());
  buffer.resize(writer.size());
  return buffer;
}

bool loaded(std::span<const std::uint8_t> bytes, Everything& e) {
  StateReader reader(bytes);
  return reader.section(kTag, 3, [&] { reader(e); });
}

// With the section's checksum corrected, as an attacker would.
std::vector<std::uint8_t> sealed(std::vector<std::uint8_t> bytes) {
  if (bytes.size() < sizeof(StateSectionHead)) return bytes;
  StateSectionHead head;
  std::memcpy(&head, bytes.data(), sizeof head);
  head.bytes = bytes.size() - sizeof head;
  head.crc = crc32(std::span(bytes).subspan(sizeof head));
  std::memcpy(bytes.data(), &head, sizeof head);
  return bytes;
}

TEST(StateArchive, BringsEveryKindOfMemberBack) {
  const Everything before = sample();
  Everything after;
  after.never = Inner{};
  after.names = {{9, "old"}};
  ASSERT_TRUE(loaded(saved(before), after));
  EXPECT_EQ(after.number, before.number);
  EXPECT_EQ(after.real, before.real);
  EXPECT_EQ(after.flag, before.flag);
  EXPECT_EQ(after.colour, before.colour);
  EXPECT_EQ(after.text, before.text);
  EXPECT_EQ(after.three, before.three);
  EXPECT_EQ(after.list, before.list);
  EXPECT_EQ(after.pool, before.pool);
  EXPECT_EQ(after.maybe, before.maybe);
  EXPECT_TRUE(std::signbit(after.maybe->x));
  EXPECT_EQ(after.never, std::nullopt);
  EXPECT_EQ(after.names, before.names);
  EXPECT_EQ(after.pairs, before.pairs);
  ASSERT_EQ(after.queue.size(), before.queue.size());
  for (std::size_t i = 0; i < after.queue.size(); ++i) EXPECT_EQ(after.queue[i], before.queue[i]);
  EXPECT_EQ(after.queue.refused(), 1u);
  EXPECT_EQ(after.queue.highWater(), 3u);
  EXPECT_EQ(saved(after), saved(before));
}

TEST(StateArchive, RefusesBytesThatAreCutOffAtAnyPlace) {
  const std::vector<std::uint8_t> whole = saved(sample());
  for (std::size_t size = 0; size < whole.size(); ++size) {
    std::vector<std::uint8_t> part(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    Everything e;
    EXPECT_FALSE(loaded(part, e)) << size;
    EXPECT_FALSE(loaded(sealed(part), e)) << size;
    if (size == 0) continue;
    EXPECT_FALSE(StateReader(part).sectionsAreWhole()) << size;
  }
  EXPECT_TRUE(StateReader(whole).sectionsAreWhole());
}

TEST(StateArchive, RefusesEveryFlippedBit) {
  const std::vector<std::uint8_t> whole = saved(sample());
  for (std::size_t bit = 0; bit < whole.size() * 8; ++bit) {
    const bool unused = bit / 8 >= offsetof(StateSectionHead, unused) && bit / 8 < sizeof(StateSectionHead);
    std::vector<std::uint8_t> damaged = whole;
    damaged[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    Everything e;
    EXPECT_EQ(loaded(damaged, e), unused) << bit;
  }
}

TEST(StateArchive, SurvivesDamageWithARightChecksum) {
  const std::vector<std::uint8_t> whole = saved(sample());
  for (std::size_t bit = sizeof(StateSectionHead) * 8; bit < whole.size() * 8; ++bit) {
    std::vector<std::uint8_t> damaged = whole;
    damaged[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    Everything e;
    if (!loaded(sealed(damaged), e)) continue;
    EXPECT_LE(e.list.size(), 4u);
    EXPECT_LE(e.queue.size(), 3u);
    EXPECT_LE(e.colour, Colour::kBlue);
  }
}

TEST(StateArchive, SaysWhyItRefuses) {
  std::vector<std::uint8_t> bytes = saved(sample());
  Everything e;
  StateReader other(bytes);
  EXPECT_FALSE(other.section(stateTag("MAPC"), 3, [&] { other(e); }));
  EXPECT_STREQ(other.failure(), "another part stands where one was expected");
  StateReader older(bytes);
  EXPECT_FALSE(older.section(kTag, 4, [&] { older(e); }));
  EXPECT_STREQ(older.failure(), "a part was written by another version of the program");
  StateReader longer(bytes);
  EXPECT_FALSE(longer.section(kTag, 3, [&] { longer(e.number); }));
  EXPECT_STREQ(longer.failure(), "a part is longer than it should be");
  bytes.back() ^= 1;
  StateReader damaged(bytes);
  EXPECT_FALSE(damaged.section(kTag, 3, [&] { damaged(e); }));
  EXPECT_STREQ(damaged.failure(), "a checksum is wrong");
}

TEST(StateArchive, AWriterWithAFullBufferReportsThatAndHowMuchItLacks) {
  const Everything e = sample();
  const std::size_t needed = saved(e).size();
  for (std::size_t size = 0; size < needed; ++size) {
    std::vector<std::uint8_t> buffer(size + 1, 0xAA);
    StateWriter writer(std::span<std::uint8_t>(buffer).first(size));
    writer.section(kTag, 3, [&] { writer(e); });
    EXPECT_TRUE(writer.full()) << size;
    EXPECT_GT(writer.needed(), size);
    EXPECT_EQ(buffer.back(), 0xAA);
  }
}

TEST(StateArchive, SectionsFollowEachOther) {
  std::vector<std::uint8_t> buffer(100);
  StateWriter writer(buffer);
  int a = 1, b = 2;
  writer.section(stateTag("AAAA"), 1, [&] { writer(a); });
  writer.section(stateTag("BBBB"), 1, [&] { writer(b); });
  StateReader reader(writer.written());
  EXPECT_TRUE(reader.sectionsAreWhole());
  int c = 0, d = 0;
  EXPECT_TRUE(reader.section(stateTag("AAAA"), 1, [&] { reader(c); }));
  EXPECT_TRUE(reader.section(stateTag("BBBB"), 1, [&] { reader(d); }));
  EXPECT_EQ(c, 1);
  EXPECT_EQ(d, 2);
  EXPECT_EQ(reader.left(), 0u);
}

TEST(StateArchive, TheChecksumIsTheOneOfZlib) {
  const std::string text = "123456789";
  const std::span<const std::uint8_t> bytes(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  EXPECT_EQ(crc32(bytes), 0xCBF43926u);
  EXPECT_EQ(crc32(bytes.subspan(4), crc32(bytes.first(4))), 0xCBF43926u);
}

std::size_t bytesOf(const EightNumbers& numbers) {
  std::array<std::uint8_t, kMostPacked> bytes{};
  const std::size_t size = packNumbers(numbers, bytes.data());
  std::uint32_t lengths = 0;
  std::memcpy(&lengths, bytes.data(), sizeof lengths);
  EXPECT_EQ(kPackedHead + packedBytes(lengths), size);
  EXPECT_EQ(unpackNumbers(lengths, bytes.data() + kPackedHead), numbers);
  return size;
}

TEST(PackedNumbers, TakeAsManyBytesAsTheyNeed) {
  EXPECT_EQ(bytesOf({}), kPackedHead);
  EXPECT_EQ(bytesOf({1, 255, 0, 0, 0, 0, 0, 0}), kPackedHead + 2);
  EXPECT_EQ(bytesOf({256, 65535, 65536, 0, 0, 0, 0, 1}), kPackedHead + 2 + 2 + 3 + 1);
  EightNumbers largest;
  largest.fill(~std::uint64_t{0});
  EXPECT_EQ(bytesOf(largest), kMostPacked);
}

TEST(PackedNumbers, AnyNumbersComeBack) {
  std::mt19937_64 random(1);
  for (int k = 0; k < 1000; ++k) {
    EightNumbers numbers;
    for (std::uint64_t& n : numbers) n = random() >> (random() % 64);
    (void)bytesOf(numbers);
  }
}

TEST(PackedNumbers, ANumberOfMoreThanEightBytesIsNone) {
  EXPECT_EQ(packedBytes(0x00000009), kMostPacked);
  EXPECT_EQ(packedBytes(0xF0000000), kMostPacked);
}

}  // namespace
}  // namespace fathom::rt
