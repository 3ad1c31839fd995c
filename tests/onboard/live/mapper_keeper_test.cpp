// When the mapper is killed, started again, and with what; and what the vehicle does for itself meanwhile.
#include <gmock/gmock.h>
#include <sys/wait.h>
#include <unistd.h>

#include "realtime/base/units.hpp"
#include "realtime/onboard/live/devices/device_threads.hpp"
#include "realtime/onboard/live/dive_lock.hpp"
#include "realtime/onboard/live/watched_threads.hpp"
#include "realtime/onboard/mapper/input_feed.hpp"
#include "realtime/onboard/mapper/mapper_keeper.hpp"
#include "telemetry/wire/frame.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::onboard {
namespace {

// A mapper that obeys its keeper, observed ten times a second.
class Kept : public testing::Test {
 protected:
  MapperKeeper::Orders look() {
    seen.now_ns += kSecond_ns / 10;
    const MapperKeeper::Orders orders = keeper.step(seen);
    if (orders.kill) seen.running = false;
    if (orders.start) {
      seen.running = true;
      seen.phase = MapperPhase::kStarting;
      seen.loading = seen.working_pair = 0;
    }
    return orders;
  }
  // Starts as soon as it may; after how long.
  double waitForStart() {
    const std::int64_t from = seen.now_ns;
    for (int k = 0; k < 1000; ++k) {
      const MapperKeeper::Orders orders = look();
      if (!orders.start) continue;
      from_empty = from_empty || orders.from_empty;
      return static_cast<double>(seen.now_ns - from) * 1e-9;
    }
    ADD_FAILURE() << "never started";
    return 0;
  }
  void follow(std::uint64_t position) {
    seen.phase = MapperPhase::kRunning;
    seen.position = position;
    ++seen.beats;
    EXPECT_FALSE(look().kill);
  }
  MapperKeeper::Orders die() {
    seen.running = false;
    const MapperKeeper::Orders orders = look();
    from_empty = from_empty || orders.from_empty;
    return orders;
  }

  MapperKeeper keeper{MapperKeeper::Config{}};
  MapperKeeper::Seen seen;
  bool from_empty = false;
};

TEST_F(Kept, IsStartedAtOnceAndAgainAtOnceAfterItHadGotFurther) {
  EXPECT_LE(waitForStart(), 0.2);
  follow(100);
  const MapperKeeper::Orders orders = die();
  EXPECT_TRUE(orders.lost);
  EXPECT_TRUE(orders.start);
  EXPECT_EQ(keeper.starts(), 2U);
}

TEST_F(Kept, IsKilledWhenItGetsNoFurtherButNotWhileItBeatsOrFinishes) {
  (void)waitForStart();
  for (int k = 0; k < 100; ++k) follow(10);  // many beats in one place: a long piece of work
  MapperKeeper::Orders orders;
  int looks = 0;
  while (!orders.kill && looks < 100) {
    orders = look();
    ++looks;
  }
  EXPECT_NEAR(looks, 21, 2) << "two seconds without a beat";
  EXPECT_THAT(orders.why, testing::HasSubstr("2000 ms"));
  EXPECT_TRUE(look().lost);
  (void)waitForStart();
}

TEST_F(Kept, MayFinishAsLongAsItWorksOnIt) {
  (void)waitForStart();
  seen.phase = MapperPhase::kFinishing;
  for (int k = 0; k < 1000; ++k) {
    seen.cpu_ns += 10'000'000;
    EXPECT_FALSE(look().kill);
  }
  bool killed = false;
  for (int k = 0; k < 400 && !killed; ++k) {
    seen.cpu_ns += 10'000;  // its other threads look whether there is something to do
    killed = look().kill;
  }
  EXPECT_TRUE(killed);
}

TEST_F(Kept, IsKilledWhenItSaysThatAllIsOverAndGoesOn) {
  (void)waitForStart();
  follow(50);
  seen.phase = MapperPhase::kRefused;
  bool killed = false;
  for (int k = 0; k < 30 && !killed; ++k) {
    ++seen.beats;
    killed = look().kill;
  }
  EXPECT_TRUE(killed);
  seen.running = false;
  const MapperKeeper::Orders orders = look();
  EXPECT_TRUE(orders.lost && orders.start) << "at once: it had refused nothing";
}

TEST_F(Kept, HasTimeToMakeItsPoolsAndToLoad) {
  (void)waitForStart();
  for (int k = 0; k < 250; ++k) EXPECT_FALSE(look().kill);
  for (int k = 0; k < 100 && seen.running; ++k) (void)look();
  EXPECT_FALSE(seen.running) << "but not for ever";
}

TEST_F(Kept, WaitsLongerAndLongerWhenItGetsNoFurtherAndAtLastBeginsEmpty) {
  (void)waitForStart();
  follow(50);
  std::vector<double> waits;
  ASSERT_TRUE(die().start);
  while (!from_empty && waits.size() < 20) {
    EXPECT_FALSE(die().start);
    waits.push_back(waitForStart());
  }
  EXPECT_TRUE(from_empty);
  EXPECT_EQ(waits.size(), 6U);
  EXPECT_LE(waits.front(), 0.3);
  EXPECT_GT(waits.back(), 1.0);
  EXPECT_LE(waits.back(), 30.0);
}

TEST_F(Kept, KeepsFromTheNextWhatItDiedOf) {
  (void)waitForStart();
  seen.phase = MapperPhase::kLoading;
  seen.loading = 12;
  EXPECT_EQ(die().avoid, 12U);
  if (!seen.running) (void)waitForStart();
  follow(50);
  seen.working_pair = 8;  // pair 7
  EXPECT_FALSE(die().drop_pair.has_value()) << "once may be chance";
  if (!seen.running) (void)waitForStart();
  seen.phase = MapperPhase::kCatchingUp;
  seen.working_pair = 8;
  EXPECT_EQ(die().drop_pair, 7U);
}

TEST_F(Kept, IsLeftAloneWhenAllIsDoneWhateverItsExit) {
  (void)waitForStart();
  follow(50);
  seen.phase = MapperPhase::kEnded;
  const MapperKeeper::Orders orders = die();
  EXPECT_FALSE(orders.lost || orders.start);
  EXPECT_TRUE(keeper.done());
}

telemetry::DecodedFrame decoded(const OutgoingFrame& frame) {
  return telemetry::decodeFrame(frame.data());
}

TEST(OwnStatus, SpeaksOnlyWhileNobodyMapsAndBeyondWhatTheMapperMayHaveSaid) {
  OwnStatus::Config config;
  config.identity = {3, 77};
  OwnStatus own(config);
  telemetry::Status status{.health = telemetry::kHealthNoMap};
  OutgoingFrame frame;
  std::int64_t now = 1000 * kSecond_ns;
  own.set(status, true);
  EXPECT_FALSE(own.next(now, frame));
  // The mapper's last frame.
  OutgoingFrame last;
  const std::array<std::uint8_t, 4> payload{};
  last.size = static_cast<std::uint16_t>(telemetry::encodeFrame(
      {config.identity, 500, telemetry::MessageType::kTrack, false}, payload, last.bytes));
  own.sent(now, last.data(), false);
  own.set(status, false);
  EXPECT_FALSE(own.next(now += 10 * kSecond_ns, frame)) << "it may come back at once";
  std::vector<std::uint16_t> sequences;
  for (int k = 0; k < 100; ++k) {
    now += kSecond_ns;
    if (!own.next(now, frame)) continue;
    const telemetry::DecodedFrame d = decoded(frame);
    ASSERT_EQ(d.verdict, telemetry::FrameVerdict::kAccepted);
    EXPECT_EQ(d.header.type, telemetry::MessageType::kStatus);
    EXPECT_EQ(d.header.identity, config.identity);
    telemetry::Status sent;
    ASSERT_TRUE(telemetry::decodeStatus(d.payload, sent));
    EXPECT_NE(sent.health & telemetry::kHealthNoMap, 0);
    sequences.push_back(d.header.sequence());
    own.sent(now, frame.data(), true);
  }
  ASSERT_GE(sequences.size(), 4U) << "within a minute, and then again and again";
  EXPECT_EQ(sequences[0], 501 + config.passed_over);
  EXPECT_EQ(sequences[1], sequences[0] + 1);
  telemetry::Version free = 0;
  ASSERT_TRUE(own.nextVersion(free));
  EXPECT_EQ(static_cast<std::uint16_t>(free), sequences.back() + 1);
  own.set(status, true);
  EXPECT_FALSE(own.next(now + 1000 * kSecond_ns, frame));
}

TEST(OwnStatus, SpeaksInBundlesWhereTheModemsFramesAreOfOneSizeAndCountsThoseOfTheMapper) {
  OwnStatus::Config config;
  config.identity = {3, 77};
  config.padded_bytes = 100;
  OwnStatus own(config);
  OutgoingFrame frame;
  telemetry::ModemFrameWriter modem(frame.bytes, false);
  const std::array<std::uint8_t, 4> payload{};
  for (const std::uint16_t sequence : {500, 501, 502})
    modem.add(telemetry::encodeFrame({config.identity, sequence, telemetry::MessageType::kTrack, false},
                                     payload, modem.room()));
  frame.size = static_cast<std::uint16_t>(modem.finish());
  own.sent(1000 * kSecond_ns, frame.data(), false);
  own.set({}, false);
  ASSERT_TRUE(own.next(1100 * kSecond_ns, frame));
  EXPECT_EQ(frame.size, config.padded_bytes);
  EXPECT_EQ(telemetry::paddedBytes(frame.data()), config.padded_bytes);
  telemetry::LinkFrames link_frames(frame.data());
  const auto status = link_frames.next();
  ASSERT_TRUE(status);
  const telemetry::DecodedFrame d = telemetry::decodeFrame(*status);
  EXPECT_EQ(d.header.type, telemetry::MessageType::kStatus);
  EXPECT_EQ(d.header.sequence(), 503 + config.passed_over);
}

TEST(PartStates, TellsWhenAPartsStateIsAnother) {
  PartStates parts;
  EXPECT_TRUE(parts.set("recorder", PartState::kRunning));
  EXPECT_FALSE(parts.set("recorder", PartState::kRunning));
  EXPECT_TRUE(parts.set("recorder", PartState::kFailed, "no room"));
  EXPECT_EQ(parts.read("recorder").reason, "no room");
  EXPECT_EQ(parts.read("mapper").state, PartState::kStarting);
  EXPECT_STREQ(nameOf(PartState::kCatchingUp), "catching up");
}

TEST(DiveLock, LetsOneProgramDiveInAFolderAndNamesItToTheNext) {
  const test::TemporaryFolder folder;
  EXPECT_FALSE(DiveLock::holder(folder.path()).has_value());
  {
    const DiveLock lock(folder.path());
    EXPECT_EQ(DiveLock::holder(folder.path()), ::getpid());
    EXPECT_THAT(test::refusal([&] { const DiveLock second(folder.path()); }),
                testing::HasSubstr("process " + std::to_string(::getpid())));
  }
  EXPECT_FALSE(DiveLock::holder(folder.path()).has_value());
  const DiveLock again(folder.path());
}

// Bytes that a failing mapper may have written.
TEST(MapperUp, WhatNoMapperShowsIsIgnored) {
  const auto up = std::make_unique<MapperUp>();
  MapState shown;
  EXPECT_FALSE(up->readMap(shown));
  MapState good;
  good.pairs = 7;
  up->state.write(good);
  ASSERT_TRUE(up->readMap(shown));
  EXPECT_EQ(shown.pairs, 7U);
  const auto refuses = [&](auto spoil) {
    MapState bad;
    bad.pairs = 8;
    spoil(bad);
    up->state.write(bad);
    EXPECT_FALSE(up->readMap(shown));
    EXPECT_EQ(shown.pairs, 7U);
  };
  refuses([](MapState& s) { s.T_nav_odom = SE3(Eigen::Quaterniond(NAN, 0, 0, 0), Eigen::Vector3d::Zero()); });
  refuses([](MapState& s) { s.T_nav_odom = SE3(Eigen::Quaterniond::Identity(), {0, NAN, 0}); });
  refuses([](MapState& s) { s.mapped_area = INFINITY; });
  refuses([](MapState& s) { s.status.north = NAN; });
  up->phase = kMapperPhases;
  EXPECT_EQ(up->current(), MapperPhase::kRefused);
}

TEST(InputFeed, GoesOnWithoutWhatNeitherMemoryNorDiskHasInTimeAndCountsIt) {
  const test::TemporaryFolder folder;
  const auto down = std::make_unique<MapperDown>();
  InputFeed feed(folder.path(), *down, 0);
  constexpr std::uint64_t kMore = 100;
  for (std::uint64_t i = 0; i < InputBroadcast::capacity() + kMore; ++i)
    down->inputs.push({static_cast<std::int64_t>(i), io::Tick{}});
  io::OnboardInput input;
  ASSERT_TRUE(feed.next(input));
  const auto first = static_cast<std::uint64_t>(input.arrival_utc_ns);
  EXPECT_EQ(first, InputBroadcast::capacity() / 2 + kMore);
  EXPECT_EQ(feed.passedOver(), first);
  EXPECT_EQ(feed.skipped(), first);
  ASSERT_TRUE(feed.next(input));
  EXPECT_EQ(feed.position(), first + 2);
}

// When the vehicle process ends because it cannot continue.

class Watched : public testing::Test {
 protected:
  std::string look() {
    now_ns += kSecond_ns / 5;
    return watch.look(now_ns, navigation, supervisor);
  }
  ProgramWatch watch{{2 * kSecond_ns, 5 * kSecond_ns}};
  std::int64_t now_ns = 0;
  std::uint64_t navigation = 0, supervisor = 0;
};

TEST_F(Watched, GoesOnWhileNavigationAndSupervisorLive) {
  for (int k = 0; k < 100; ++k) {
    ++navigation;
    if (k % 5 == 0) ++supervisor;
    EXPECT_EQ(look(), "");
    EXPECT_TRUE(watch.alive());
  }
}

TEST_F(Watched, EndsWhenNavigationIsSilentForItsLimit) {
  (void)look();
  int looks = 0;
  for (; looks < 100 && look().empty(); ++looks) ++supervisor;
  EXPECT_EQ(looks, 9);
  EXPECT_FALSE(watch.alive());
  EXPECT_THAT(look(), testing::HasSubstr("navigation"));
}

TEST_F(Watched, EndsWhenTheSupervisorIsSilentForItsLimit) {
  (void)look();
  int looks = 0;
  for (; looks < 100 && look().empty(); ++looks) ++navigation;
  EXPECT_EQ(looks, 24);
  EXPECT_THAT(look(), testing::HasSubstr("supervisor"));
}

TEST(HungRestarts, EachIsWaitedForTwiceAsLongOverStartsOfTheProgram) {
  const test::TemporaryFolder folder;
  EXPECT_EQ(HungRestarts(folder.path()).patienceNs(2 * kSecond_ns), 4 * kSecond_ns);
  EXPECT_TRUE(HungRestarts(folder.path()).note());
  EXPECT_EQ(HungRestarts(folder.path()).patienceNs(2 * kSecond_ns), 8 * kSecond_ns);
  for (int k = 0; k < 30; ++k) EXPECT_TRUE(HungRestarts(folder.path()).note());
  EXPECT_EQ(HungRestarts(folder.path()).patienceNs(2 * kSecond_ns), 600 * kSecond_ns);
}

TEST(HungRestarts, WhereTheCountCannotBeKeptTheProgramDoesNotEnd) {
  HungRestarts restarts("/dev/null");
  EXPECT_FALSE(restarts.note());
}

}  // namespace
}  // namespace fathom::onboard
