#include "realtime/kernel/object_pool.hpp"

#include <gtest/gtest.h>

#include <new>
#include <vector>

namespace fathom::rt {
namespace {

struct Tracked {
  explicit Tracked(int v) : value(v) { ++alive; }
  ~Tracked() { --alive; }
  Tracked(const Tracked&) = delete;
  Tracked& operator=(const Tracked&) = delete;
  int value;
  static inline int alive = 0;
};

TEST(ObjectPool, GivesEveryObjectThenNullptrAndCounts) {
  Arena arena(1 << 14);
  ObjectPool<Tracked> pool(arena, 3);
  EXPECT_EQ(pool.used(), 0u);
  EXPECT_EQ(pool.free(), 3u);
  std::vector<Tracked*> out;
  for (int i = 0; i < 3; ++i) out.push_back(pool.acquire(i));
  for (int i = 0; i < 3; ++i) EXPECT_EQ(out[static_cast<std::size_t>(i)]->value, i);
  EXPECT_EQ(pool.acquire(9), nullptr);
  EXPECT_EQ(pool.refused(), 1u);
  EXPECT_EQ(pool.highWater(), 3u);
  EXPECT_EQ(Tracked::alive, 3);
}

TEST(ObjectPool, ReusesReleasedObjectsInAnyOrder) {
  Arena arena(1 << 14);
  ObjectPool<Tracked> pool(arena, 3);
  Tracked* a = pool.acquire(1);
  Tracked* b = pool.acquire(2);
  Tracked* c = pool.acquire(3);
  pool.release(b);
  EXPECT_EQ(Tracked::alive, 2);
  EXPECT_EQ(pool.acquire(4), b);
  pool.release(a);
  pool.release(c);
  pool.release(b);
  EXPECT_EQ(pool.free(), 3u);
  EXPECT_EQ(pool.highWater(), 3u);
}

TEST(ObjectPool, HandlesNameTheObjectAndFreeSlotsAreEmpty) {
  Arena arena(1 << 14);
  ObjectPool<Tracked> pool(arena, 4);
  Tracked* a = pool.acquire(7);
  const std::uint32_t handle = pool.indexOf(a);
  EXPECT_EQ(pool.at(handle), a);
  pool.release(a);
  EXPECT_EQ(pool.at(handle), nullptr);
}

TEST(ObjectPool, DestroysWhatIsStillOutAtItsOwnEnd) {
  Arena arena(1 << 14);
  {
    ObjectPool<Tracked> pool(arena, 2);
    ASSERT_NE(pool.acquire(1), nullptr);
  }
  EXPECT_EQ(Tracked::alive, 0);
}

TEST(ObjectPool, ThatDoesNotFitItsArenaFailsAtConstruction) {
  Arena arena(4096);
  EXPECT_THROW((ObjectPool<std::array<double, 64>>(arena, 1000)), std::bad_alloc);
}

TEST(ObjectPool, ItsByteCountCoversWhatItTakes) {
  Arena arena(1 << 16);
  const ObjectPool<double> pool(arena, 100);
  EXPECT_LE(arena.used(), ObjectPool<double>::bytesFor(100) + 2 * alignof(std::max_align_t));
}

TEST(ObjectPoolDeathTest, ReleasingTwiceTerminates) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  Arena arena(1 << 14);
  ObjectPool<double> pool(arena, 2);
  double* a = pool.acquire(1.0);
  pool.release(a);
  EXPECT_DEATH(pool.release(a), "released twice");
}

TEST(ObjectPoolDeathTest, ReleasingAForeignPointerTerminates) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  Arena arena(1 << 14);
  ObjectPool<double> pool(arena, 2);
  double foreign = 0;
  EXPECT_DEATH(pool.release(&foreign), "not of this pool");
}

}  // namespace
}  // namespace fathom::rt
