#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "realtime/base/input_error.hpp"
#include "recon/topside/work/stage_store.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;
using Access = StageStore::Access;

Digest keyOf(int n) {
  return Hasher().add(n).finish();
}

fs::path fileOf(const fs::path& stage) {
  for (const auto& entry : fs::directory_iterator(stage))
    if (entry.path().extension() == ".work") return entry.path();
  return {};
}

class Work : public ::testing::Test {
 protected:
  void write(StageStore& store, const Digest& key) const {
    WorkFileWriter file = store.writer("piece", "3", key);
    file.add("mesh", mesh_);
    file.add("empty", {});
    file.commit();
    store.written("piece", "3", key, {{"seconds", 1.5}});
  }
  test::TemporaryFolder place_;
  fs::path folder_ = place_.path() / "topside.work";
  Bytes mesh_ = {1, 2, 3, 250, 0, 7};
};

TEST_F(Work, AResultIsReadAsItWasWrittenAndOnlyUnderItsKey) {
  {
    StageStore store(folder_, Access::kAlone);
    EXPECT_FALSE(store.find("piece", "3", keyOf(1)));
    write(store, keyOf(1));
  }
  StageStore store(folder_, Access::kShared);
  const auto found = store.find("piece", "3", keyOf(1));
  ASSERT_TRUE(found);
  EXPECT_EQ(found->read("mesh"), mesh_);
  EXPECT_EQ(found->digestOf("mesh"), digestOf(mesh_));
  EXPECT_TRUE(found->read("empty").empty());
  EXPECT_THROW((void)found->read("texture"), DamagedWork);
  EXPECT_FALSE(store.find("piece", "3", keyOf(2)));
  EXPECT_EQ(store.costs("piece").at("3").at("seconds"), 1.5);
}

TEST_F(Work, AnyFlippedBitIsNoticedAndTheFileIsGone) {
  std::size_t size = 1;
  for (std::size_t at = 0; at < size; ++at) {
    {
      StageStore store(folder_, Access::kAlone);
      write(store, keyOf(1));
    }
    const fs::path path = fileOf(folder_ / "piece");
    size = fs::file_size(path);
    {
      std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
      file.seekg(static_cast<std::streamoff>(at));
      const int byte = file.get() ^ (1 << at % 8);
      file.seekp(static_cast<std::streamoff>(at));
      file.put(static_cast<char>(byte));
    }
    StageStore store(folder_, Access::kAlone);
    EXPECT_FALSE(store.find("piece", "3", keyOf(1))) << "byte " << at;
    EXPECT_EQ(store.damaged(), 1u);
    EXPECT_FALSE(fs::exists(path));
  }
}

TEST_F(Work, AFileCutAnywhereIsNoResult) {
  StageStore store(folder_, Access::kAlone);
  write(store, keyOf(1));
  const fs::path path = fileOf(folder_ / "piece");
  for (auto size = fs::file_size(path); size-- > 0;) {
    fs::resize_file(path, size);
    EXPECT_FALSE(WorkFile::open(path, keyOf(1)).has_value()) << size;
  }
}

TEST_F(Work, ANewResultTakesThePlaceOfTheOldOneOfItsItem) {
  StageStore store(folder_, Access::kAlone);
  write(store, keyOf(1));
  write(store, keyOf(2));
  EXPECT_FALSE(store.find("piece", "3", keyOf(1)));
  EXPECT_TRUE(store.find("piece", "3", keyOf(2)));
}

TEST_F(Work, WhatAKilledProcessLeftIsSweptByTheNextThatIsAlone) {
  fs::path left;
  {
    StageStore store(folder_, Access::kAlone);
    write(store, keyOf(1));
    left = folder_ / "piece" / "4-0123456789abcdef.work.host.1.tmp";
    std::ofstream(left) << "half";
  }
  { StageStore store(folder_, Access::kShared); }
  EXPECT_TRUE(fs::exists(left));
  { StageStore store(folder_, Access::kAlone); }
  EXPECT_FALSE(fs::exists(left));
}

TEST_F(Work, TwoRunsDoNotWorkInOneFolderAndAForeignFolderIsRefused) {
  StageStore first(folder_, Access::kShared);
  { StageStore second(folder_, Access::kShared); }
  EXPECT_THROW(StageStore(folder_, Access::kAlone), InputError);
  std::ofstream(place_.path() / "thesis.tex") << "years of work";
  EXPECT_THROW(StageStore(place_.path(), Access::kAlone), InputError);
}

TEST(Digests, AreBlake2bAndTellListsOfTextsApart) {
  // BLAKE2b-256 of nothing, as its authors' tools give it.
  EXPECT_EQ(digestOf({}).hex(), "0e5751c026e543b2e8ab2eb06099daa1d1e5df47778f7787faab45cdf12fe3a8");
  EXPECT_NE(Hasher().add("ab", "c").finish(), Hasher().add("a", "bc").finish());
}

}  // namespace
}  // namespace fathom::topside
