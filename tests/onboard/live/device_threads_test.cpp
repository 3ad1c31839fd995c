#include "realtime/onboard/live/devices/device_threads.hpp"
#include "realtime/base/units.hpp"

#include <gmock/gmock.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <new>
#include <stdexcept>
#include <thread>

#include "realtime/kernel/time/clock.hpp"
#include "realtime/onboard/live/watched_threads.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::onboard {
namespace {

using testing::ElementsAre, testing::IsEmpty;

// Time as the test has it: device threads ask it, and nothing sleeps by it.
struct SteppedClock final : rt::Clock {
  std::atomic<std::int64_t> now{1};
  [[nodiscard]] std::int64_t monotonicNs() const noexcept override { return now; }
  [[nodiscard]] std::int64_t utcNs() const noexcept override { return now; }
  void sleepUntil(std::int64_t) noexcept override {}
};

template <class Done>
[[nodiscard]] bool comesTrue(const Done& done) {
  for (int i = 0; i < 5000; ++i) {
    if (done()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

// Throws in each poll while `throws`; else gives a sample.
struct ThrowingSource final : io::SampleSource {
  std::atomic<bool> throws{true};
  std::atomic<std::int64_t> arrival_ns{7};
  std::atomic<int> polls{0}, closed{0};
  bool poll(int, io::SampleSink& sink) override {
    ++polls;
    if (throws) throw std::runtime_error("the library is out of order");
    sink.sample(arrival_ns, DepthSample{7, 12.5});
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return true;
  }
  void close() noexcept override { ++closed; }
  [[nodiscard]] io::DeviceHealth health() const override {
    io::DeviceHealth health;
    health.name = "depth";
    health.open = true;
    return health;
  }
};

struct ThrowingCamera final : io::CameraSource {
  rt::SharedBlocks blocks{4, 64};
  std::atomic<bool> throws{true};
  std::atomic<int> closed{0}, polls{0};
  bool poll(int, io::FrameSink&) override {
    ++polls;
    if (throws) throw std::bad_alloc();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return true;
  }
  void close() noexcept override { ++closed; }
  rt::SharedBlocks& pool() noexcept override { return blocks; }
  [[nodiscard]] ImageView view(const io::CameraFrame&) noexcept override { return {}; }
  [[nodiscard]] io::DeviceHealth health() const override {
    io::DeviceHealth health;
    health.open = true;
    return health;
  }
};

// Runs a device's thread until it is stopped.
template <class Thread>
class Running {
 public:
  explicit Running(Thread& thread) : runs_([this, &thread] { thread.run(stop_); }) {}
  void stop() {
    stop_ = true;
    runs_.join();
  }

 private:
  std::atomic<bool> stop_{false};
  std::thread runs_;
};

std::uint64_t pollFailures(const io::DeviceHealth& health) {
  for (const auto& [name, value] : health.counters)
    if (name == "poll_failures") return value;
  return 0;
}

TEST(DeviceThreads, ADeviceThatThrowsIsReleasedReportedAndTriedAgainAtGrowingIntervals) {
  SteppedClock clock;
  rt::Heartbeat heart;
  InputRing inputs;
  ThrowingSource source;
  SampleThread thread(source, {&inputs, nullptr, 0, &heart}, clock);
  Running runs(thread);
  ASSERT_TRUE(comesTrue([&] { return pollFailures(thread.health()) == 1; }));
  EXPECT_FALSE(thread.health().open);
  EXPECT_EQ(thread.health().reason.view(), "the library is out of order");
  EXPECT_EQ(source.closed, 1);
  const std::uint64_t beats = heart.beats();
  ASSERT_TRUE(comesTrue([&] { return heart.beats() > beats + 1; })) << "the thread beats while it rests";
  EXPECT_EQ(source.polls, 1);
  clock.now += kSecond_ns;
  ASSERT_TRUE(comesTrue([&] { return pollFailures(thread.health()) == 2; }));
  clock.now += kSecond_ns;
  const std::uint64_t rested = heart.beats();
  ASSERT_TRUE(comesTrue([&] { return heart.beats() > rested + 1; }));
  EXPECT_EQ(source.polls, 2) << "the second rest is twice as long";
  source.throws = false;
  clock.now += kSecond_ns;
  ASSERT_TRUE(comesTrue([&] { return inputs.used() > 0 && thread.health().open; }));
  EXPECT_TRUE(thread.health().reason.empty());
  EXPECT_EQ(pollFailures(thread.health()), 2u);
  runs.stop();
}

TEST(DeviceThreads, AMisdatedArrivalIsOfNow) {
  SteppedClock clock;
  clock.now = 1000 * kSecond_ns;
  rt::Heartbeat heart;
  for (const std::int64_t misdated : {INT64_MAX, INT64_MIN}) {
    InputRing inputs;
    ThrowingSource source;
    source.throws = false;
    source.arrival_ns = misdated;
    SampleThread thread(source, {&inputs, nullptr, 0, &heart}, clock);
    Running runs(thread);
    io::OnboardInput input;
    EXPECT_TRUE(comesTrue([&] { return inputs.pop(input); }));
    EXPECT_LE(input.arrival_utc_ns, clock.now);
    EXPECT_GE(input.arrival_utc_ns, clock.now - 60 * kSecond_ns);
    runs.stop();
  }
}

TEST(DeviceThreads, ACameraThatHasNoMemoryForItsSearchIsTriedAgain) {
  SteppedClock clock;
  rt::Heartbeat heart;
  InputRing stamps;
  ThrowingCamera camera;
  FrameBroadcast broadcast;
  const std::atomic<std::uint64_t> floor{0};
  FrameLender frames(camera, broadcast, floor, 1);
  CameraThread thread(camera, {&stamps, &frames, nullptr, &heart}, clock);
  Running runs(thread);
  ASSERT_TRUE(comesTrue([&] { return pollFailures(thread.health()) == 1; }));
  EXPECT_THAT(std::string(thread.health().reason.view()), testing::HasSubstr("bad_alloc"));
  EXPECT_EQ(camera.closed, 1);
  camera.throws = false;
  clock.now += kSecond_ns;
  EXPECT_TRUE(comesTrue([&] { return thread.health().open && camera.polls > 1; }));
  runs.stop();
}

// A mapper that stalls, or is not there, holds up neither camera nor recorder.
TEST(FrameLender, LendsNoMoreThanItMayAndTakesBackWhatTheMapperIsPast) {
  ThrowingCamera camera;
  auto to = std::make_unique<FrameBroadcast>();
  std::atomic<std::uint64_t> floor{0};
  {
    FrameLender lender(camera, *to, floor, 2);
    const auto give = [&](std::uint64_t id) {
      lender.lend(io::CameraFrame{.block = camera.blocks.acquire(), .frame_id = id});
    };
    for (std::uint64_t id = 0; id < 5; ++id) give(id);
    EXPECT_EQ(camera.blocks.held(), 2U);
    EXPECT_EQ(lender.refused(), 3U);
    EXPECT_EQ(to->next(), 2U);
    LentFrame lent;
    ASSERT_EQ(to->read(1, lent), FrameBroadcast::Read::kGot);
    EXPECT_EQ(lent.frame.frame_id, 1U);
    floor = 1;
    give(5);
    EXPECT_EQ(camera.blocks.held(), 2U) << "frame 0 is back, 5 is lent";
    ASSERT_EQ(to->read(2, lent), FrameBroadcast::Read::kGot);
    EXPECT_EQ(lent.frame.frame_id, 5U);
    floor = UINT64_MAX;  // whatever a broken mapper says
    give(6);
    EXPECT_EQ(camera.blocks.held(), 1U);
  }
  EXPECT_EQ(camera.blocks.held(), 0U);
}

rt::RealtimeConfig plainThreads() {
  rt::RealtimeConfig config;
  config.soft = true;
  config.device_priority = config.soft_priority = 0;
  config.stuck_after_ns = kSecond_ns;
  return config;
}

TEST(WatchedThreads, ABodyThatThrowsEndsItsThreadAloneAndIsStartedAgainSayingWhy) {
  const rt::RealtimeConfig config = plainThreads();
  WatchedThreads threads(config);
  std::atomic<int> starts{0};
  std::atomic<bool> other_runs{false}, stop{false};
  threads.add(rt::Tier::kBestEffort, "publisher", {}, [&](rt::Heartbeat&) {
    if (++starts < 3)
      throw std::runtime_error("message " + std::to_string(starts.load()) + " cannot be sent");
    while (!stop) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  });
  threads.add(rt::Tier::kBestEffort, "other", {}, [&](rt::Heartbeat&) {
    other_runs = true;
    while (!stop) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  });
  EXPECT_THAT(threads.start(), IsEmpty());
  ASSERT_TRUE(comesTrue([&] { return other_runs && threads.reasonOf("publisher") != ""; }));
  EXPECT_EQ(threads.reasonOf("publisher"), "message 1 cannot be sent");
  EXPECT_EQ(threads.reasonOf("other"), "");

  threads.watchFrom(0);
  std::vector<std::string> events;
  threads.look(kSecond_ns, events);
  // The second start may not have thrown yet.
  std::erase(events, "publisher is stuck");
  EXPECT_THAT(events,
              ElementsAre("publisher has left (message 1 cannot be sent); started again", "other is stuck"));
  ASSERT_TRUE(comesTrue([&] { return threads.reasonOf("publisher") == "message 2 cannot be sent"; }));
  events.clear();
  threads.look(2 * kSecond_ns, events);
  EXPECT_THAT(events, IsEmpty()) << "the second start waits longer";
  threads.look(3 * kSecond_ns, events);
  EXPECT_THAT(events, testing::Contains("publisher has left (message 2 cannot be sent); started again"));
  ASSERT_TRUE(comesTrue([&] { return starts == 3; }));
  EXPECT_EQ(threads.reasonOf("publisher"), "message 2 cannot be sent") << "known after it runs again";
  stop = true;
  EXPECT_TRUE(threads.join([] { return true; }).empty());
}

TEST(WatchedThreads, ABodyThatWorkedAndLeavesIsStartedAgainAtOnce) {
  const rt::RealtimeConfig config = plainThreads();
  WatchedThreads threads(config);
  std::atomic<int> starts{0};
  threads.add(rt::Tier::kBestEffort, "left camera", {true, 10 * kSecond_ns}, [&](rt::Heartbeat& heart) {
    heart.beat(1);
    ++starts;
    throw std::runtime_error("no memory");
  });
  EXPECT_THAT(threads.start(), IsEmpty());
  ASSERT_TRUE(comesTrue([&] { return threads.reasonOf("left camera") != ""; }));
  threads.watchFrom(0);
  std::vector<std::string> events;
  threads.look(kSecond_ns / 10, events);
  EXPECT_THAT(events, ElementsAre("left camera has left (no memory); started again"));
  ASSERT_TRUE(comesTrue([&] { return starts == 2; }));
  EXPECT_TRUE(threads.join([] { return true; }).empty());
}

TEST(WatchedThreads, ABodyThatHangsIsNamedWhenItHasBeenWaitedForAndIsLeftBehindAtTheEnd) {
  const rt::RealtimeConfig config = plainThreads();
  WatchedThreads threads(config);
  std::atomic<bool> stop{false};
  threads.add(rt::Tier::kBestEffort, "modem", {}, [&](rt::Heartbeat&) {
    while (!stop) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  });
  EXPECT_THAT(threads.start(), IsEmpty());
  threads.watchFrom(0);
  const auto twice = [](std::int64_t limit_ns) { return 2 * limit_ns; };
  std::vector<std::string> events;
  threads.look(kSecond_ns, events);
  EXPECT_EQ(threads.hanging(twice), "");
  threads.look(2 * kSecond_ns, events);
  EXPECT_EQ(threads.hanging(twice), "modem");
  EXPECT_THAT(threads.join([] { return true; }), ElementsAre("modem")) << "no longer than its limit";
  stop = true;
  EXPECT_THAT(threads.join([] { return true; }), IsEmpty());
}

TEST(WatchedThreads, ABodyThatIsNotToBeStartedAgainIsGivenUpWithItsReason) {
  const rt::RealtimeConfig config = plainThreads();
  WatchedThreads threads(config);
  threads.add(rt::Tier::kBestEffort, "vision", {false},
              [&](rt::Heartbeat&) { throw std::length_error("no such square"); });
  EXPECT_THAT(threads.start(), IsEmpty());
  EXPECT_TRUE(threads.join([] { return true; }).empty());
  threads.watchFrom(0);
  std::vector<std::string> events;
  threads.look(kSecond_ns, events);
  EXPECT_THAT(events, ElementsAre("vision has left (no such square); going on without it"));
}

// In a process of its own, which may have no thread beside the first.
int startWithoutThreads() {
  const rt::RealtimeConfig config = plainThreads();
  WatchedThreads threads(config);
  threads.add(rt::Tier::kBestEffort, "recorder", {}, [](rt::Heartbeat&) {});
  threads.add(rt::Tier::kBestEffort, "publisher", {}, [](rt::Heartbeat&) {});
  const rlimit none = {0, 0};
  constexpr uid_t kNobody = 65534;  // the system's limit is not root's
  if (::setrlimit(RLIMIT_NPROC, &none) != 0 || (::geteuid() == 0 && ::setuid(kNobody) != 0)) return 2;
  return threads.start() == std::vector<std::string>{"recorder", "publisher"} ? 0 : 1;
}

TEST(WatchedThreads, ThreadsThatTheSystemDoesNotGiveAreNamed) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(::_exit(startWithoutThreads()), testing::ExitedWithCode(0), "");
}

// Gives the modem's received frames, and keeps the sent ones.
struct SyntheticModem final : FramePort {
  std::vector<std::vector<std::uint8_t>> received;
  std::size_t given = 0;
  bool send(std::span<const std::uint8_t>) noexcept override { return true; }
  std::size_t receive(std::span<std::uint8_t> buffer) noexcept override {
    if (given == received.size()) return 0;
    const auto& frame = received[given++];
    std::copy(frame.begin(), frame.end(), buffer.begin());
    return frame.size();
  }
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override { return 0; }
};

TEST(DeviceThreads, EveryLinkFrameOfABundleIsAnInput) {
  SyntheticModem modem;
  std::vector<std::uint8_t> bundle(FramePort::kMaxFrameBytes);
  telemetry::ModemFrameWriter writer(bundle, true);
  for (const std::uint8_t size : {40, 250, 30}) {
    std::fill_n(writer.room().begin(), size, size);
    writer.add(size);
  }
  bundle.resize(writer.finish());
  modem.received = {bundle, std::vector<std::uint8_t>(32, 7), std::vector<std::uint8_t>(2000, 8)};
  SteppedClock clock;
  rt::Heartbeat heart;
  InputRing inputs;
  const auto outgoing = std::make_unique<ModemRing>();
  OwnStatus own({});
  ModemThread thread(modem, {outgoing.get(), &own, &inputs, nullptr, 0, &heart}, clock);
  Running runs(thread);
  ASSERT_TRUE(comesTrue([&] { return thread.counters().received == 3 && heart.beats() > 0; }));
  runs.stop();
  std::vector<std::pair<std::size_t, int>> frames;
  for (io::OnboardInput input; inputs.pop(input);)
    if (const auto* frame = std::get_if<io::ModemFrame>(&input.what))
      frames.emplace_back(frame->size, frame->bytes[0]);
  EXPECT_THAT(frames,
              ElementsAre(std::pair(40U, 40), std::pair(250U, 250), std::pair(30U, 30), std::pair(32U, 7)));
}

}  // namespace
}  // namespace fathom::onboard
