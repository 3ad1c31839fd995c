#include "realtime/kernel/rings/broadcast_ring.hpp"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <memory>
#include <system_error>
#include <thread>

#include "realtime/kernel/memory/shared_memory.hpp"

namespace fathom::rt {
namespace {

// Whole only if all its numbers are the same.
struct Wide {
  std::array<std::uint64_t, 9> same{};
  static Wide of(std::uint64_t n) {
    Wide wide;
    wide.same.fill(n);
    return wide;
  }
  [[nodiscard]] bool whole() const {
    for (const std::uint64_t n : same)
      if (n != same[0]) return false;
    return true;
  }
};
using Ring = BroadcastRing<Wide, 8>;

TEST(BroadcastRing, GivesEachPositionToEveryReaderThatAsks) {
  Ring ring;
  Wide value = Wide::of(77);
  EXPECT_EQ(ring.read(0, value), Ring::Read::kNotYet);
  EXPECT_EQ(value.same[0], 77U) << "untouched";
  for (std::uint64_t n = 0; n < 8; ++n) ring.push(Wide::of(100 + n));
  for (int reader = 0; reader < 2; ++reader)
    for (std::uint64_t n = 0; n < 8; ++n) {
      ASSERT_EQ(ring.read(n, value), Ring::Read::kGot);
      EXPECT_EQ(value.same[0], 100 + n);
    }
  EXPECT_EQ(ring.read(8, value), Ring::Read::kNotYet);
}

TEST(BroadcastRing, SaysWhatIsOverwrittenAndWhatWasBeforeItsBeginning) {
  Ring ring;
  ring.start(1000);
  Wide value;
  EXPECT_EQ(ring.read(999, value), Ring::Read::kOverrun);
  EXPECT_EQ(ring.read(1000, value), Ring::Read::kNotYet);
  for (std::uint64_t n = 0; n < 9; ++n) ring.push(Wide::of(n));
  EXPECT_EQ(ring.next(), 1009U);
  EXPECT_EQ(ring.read(1000, value), Ring::Read::kOverrun);
  ASSERT_EQ(ring.read(1001, value), Ring::Read::kGot);
  EXPECT_EQ(value.same[0], 1U);
}

TEST(BroadcastRing, NeverGivesATornEntryToAReaderThatIsLapped) {
  Ring ring;
  std::atomic<bool> stop{false};
  std::thread writer([&] {
    for (std::uint64_t n = 0; !stop; ++n) ring.push(Wide::of(n));
  });
  std::uint64_t got = 0, overrun = 0;
  for (std::uint64_t position = 0; got < 2000 || overrun == 0;) {
    Wide value;
    switch (ring.read(position, value)) {
      case Ring::Read::kGot:
        ASSERT_TRUE(value.whole());
        ASSERT_EQ(value.same[0], position);
        ++got;
        ++position;
        break;
      case Ring::Read::kNotYet:
        break;
      case Ring::Read::kOverrun:
        ++overrun;
        position = ring.next() - 1;
        break;
    }
  }
  stop = true;
  writer.join();
}

TEST(SharedRecord, GivesTheNewestWholeValueAndNoneBeforeTheFirst) {
  SharedRecord<Wide> record;
  Wide value = Wide::of(7);
  EXPECT_FALSE(record.read(value));
  EXPECT_EQ(value.same[0], 7U);
  record.write(Wide::of(1));
  std::atomic<bool> stop{false};
  std::thread writer([&] {
    for (std::uint64_t n = 1; !stop; ++n) record.write(Wide::of(n));
  });
  std::uint64_t last = 0;
  for (int k = 0; k < 2000; ++k) {
    if (!record.read(value)) continue;
    ASSERT_TRUE(value.whole());
    ASSERT_GE(value.same[0], last);
    last = value.same[0];
  }
  stop = true;
  writer.join();
}

TEST(SharedMemory, AnotherMappingSeesWhatIsWrittenAndCannotWriteWhereItMayOnlyRead) {
  SharedMemory mine(5000);
  EXPECT_GE(mine.bytes(), 5000U);
  mine.data()[4999] = std::byte{42};
  const SharedMemory other(::dup(mine.file()), 5000, false);
  EXPECT_EQ(other.data()[4999], std::byte{42});
  EXPECT_DEATH(other.data()[0] = std::byte{1}, "");
}

TEST(SharedMemory, RefusesNothingMoreThanThereIsAndAFileThatIsTooShort) {
  EXPECT_THROW(SharedMemory(0), std::system_error);
  const SharedMemory mine(100);
  EXPECT_THROW(SharedMemory(::dup(mine.file()), mine.bytes() + 1, true), std::system_error);
}

// As the mapper and the vehicle process are.
TEST(SharedMemory, ARingInItCrossesToAnotherProcessThatIsKilledInTheMiddle) {
  SharedMemory memory(sizeof(SharedRecord<Wide>));
  auto* record = new (memory.data()) SharedRecord<Wide>;
  const pid_t child = ::fork();
  if (child == 0)
    for (std::uint64_t n = 1;; ++n) record->write(Wide::of(n));
  Wide value;
  while (!record->read(value)) {
  }
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  if (record->read(value)) {
    EXPECT_TRUE(value.whole());
  }
  record->write(Wide::of(5));
  ASSERT_TRUE(record->read(value)) << "the next writer continues";
  EXPECT_EQ(value.same[0], 5U);
}

}  // namespace
}  // namespace fathom::rt
