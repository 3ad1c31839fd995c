#include <gmock/gmock.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <thread>

#include "firmware_if/devices/lcm/health_report.hpp"
#include "firmware_if/devices/lcm/lcm_source.hpp"
#include "firmware_if/mission/log/checked_message.hpp"
#include "realtime/base/units.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::io {
namespace {

using test::refusal, ::testing::HasSubstr;

constexpr std::int64_t kNow = 1'700'000'000 * kSecond_ns;

struct Kept final : SampleSink {
  void sample(std::int64_t arrival_utc_ns, const SensorSample& sample) noexcept override {
    EXPECT_EQ(arrival_utc_ns, kNow);
    samples.push_back(sample);
  }
  void raw(std::int64_t, std::string_view, std::span<const std::uint8_t>) noexcept override {}
  std::vector<SensorSample> samples;
};

std::uint64_t counter(const LcmSource& source, std::string_view name) {
  for (const auto& [known, value] : source.health().counters)
    if (known == name) return value;
  ADD_FAILURE() << "no counter " << name;
  return 0;
}

LcmConfig everything() {
  LcmConfig config;
  config.accept.fill(true);
  return config;
}

// A bus inside one object, as liblcm's memq provider has it.
class LcmSourceTest : public ::testing::Test {
 protected:
  std::shared_ptr<LcmBus> bus = std::make_shared<LcmBus>("memq://");
  Kept kept;
  void drain(LcmSource& source) {
    for (int i = 0; i < 10; ++i) ASSERT_TRUE(source.poll(0, kept));
  }
};

TEST_F(LcmSourceTest, EveryKindOfSampleComesThroughWhole) {
  LcmSource source(everything(), bus, "sirius", [] { return kNow; });
  DvlSample dvl{.utc_ns = kNow - 1,
                .velocity = Eigen::Vector3d(1, -0.5, 0.25),
                .range = {1.0, 2.0, std::nullopt, 4.0},
                .altitude = 1.75};
  BatterySample battery{.utc_ns = kNow - 2, .voltage = 26.5, .current = {}, .charge = {}};
  const std::vector<SensorSample> sent = {
      dvl,
      AttitudeSample{kNow - 3, 0.1, 0.2, 0.3, false},
      DepthSample{kNow - 4, 21.5},
      UsblFix{kNow - 20 * kSecond_ns, kNow - kSecond_ns, -0.6, 2.0, 20, 1.5},
      GpsFix{kNow - 6, -0.6, 2.0, 3},
      WaterSample{kNow - 7, {}, 14.5, {}, {}, {}, {}},
      battery,
      MissionProgressSample{kNow - 8, 0.25},
      GyroSample{kNow - 9, Eigen::Vector3d(0, 0.01, 0.2), {}}};
  for (const SensorSample& sample : sent) ASSERT_TRUE(bus->publish(encodeSample(kNow - 100, sample)));
  drain(source);
  ASSERT_EQ(kept.samples.size(), sent.size());
  for (std::size_t i = 0; i < sent.size(); ++i) EXPECT_EQ(kept.samples[i].index(), i);
  const auto& got = std::get<DvlSample>(kept.samples[0]);
  EXPECT_EQ(got.utc_ns, dvl.utc_ns);
  EXPECT_EQ(*got.velocity, *dvl.velocity);
  EXPECT_EQ(got.range, dvl.range);
  const auto& fix = std::get<UsblFix>(kept.samples[3]);
  EXPECT_EQ(fix.utc_ns, kNow - 20 * kSecond_ns);
  EXPECT_EQ(fix.arrival_utc_ns, kNow) << "the vehicle learns it now";
  EXPECT_EQ(*std::get<BatterySample>(kept.samples[6]).voltage, 26.5);
  EXPECT_EQ(counter(source, "progress"), 1u);
  EXPECT_EQ(source.health().samples, sent.size());
}

TEST_F(LcmSourceTest, AcfrMessagesAreTakenUntilFathomsOwnCome) {
  LcmSource source(everything(), bus, "sirius", [] { return kNow; });
  const AttitudeSample compass{kNow - kSecond_ns, 0.1, 0.2, 0.3, true};
  const DepthSample depth{kNow - kSecond_ns, 12};
  const UsblFix fix{kNow - 30 * kSecond_ns, 0, 0.5, 1.0, 10, 2};
  for (const SensorSample& sample : {SensorSample(compass), SensorSample(depth), SensorSample(fix)})
    bus->publish(*encodeAcfrTwin(sample, "sirius"));
  bus->publish(*encodeAcfrTwin(fix, "nereus"));
  drain(source);
  ASSERT_EQ(kept.samples.size(), 3u) << "another vehicle's fixes are not ours";
  EXPECT_EQ(std::get<AttitudeSample>(kept.samples[0]).heading, 0.3);
  EXPECT_EQ(std::get<DepthSample>(kept.samples[1]).depth, 12);
  bus->publish(encodeSample(kNow, compass));
  bus->publish(*encodeAcfrTwin(compass, "sirius"));
  bus->publish(*encodeAcfrTwin(depth, "sirius"));
  drain(source);
  EXPECT_EQ(kept.samples.size(), 5u);
  EXPECT_EQ(counter(source, "twins_left_out"), 1u);
}

TEST_F(LcmSourceTest, OnlyAcceptedSamplesAreTaken) {
  LcmConfig config;
  config.accept[SensorSample(DepthSample{}).index()] = true;
  LcmSource source(config, bus, "sirius", [] { return kNow; });
  bus->publish(encodeSample(kNow, AttitudeSample{kNow, 0, 0, 0, true}));
  bus->publish(encodeSample(kNow, DepthSample{kNow, 3}));
  drain(source);
  ASSERT_EQ(kept.samples.size(), 1u);
  EXPECT_TRUE(std::holds_alternative<DepthSample>(kept.samples[0]));
}

TEST_F(LcmSourceTest, DamagedImpossibleAndStaleMessagesAreCountedAndGoNoFurther) {
  LcmSource source(everything(), bus, "sirius", [] { return kNow; });
  LogMessage damaged = encodeSample(kNow, DepthSample{kNow, 3});
  damaged.data[20] ^= 0x40;
  bus->publish(damaged);
  bus->publish({"TCM", {1, 2, 3}});
  bus->publish({"FATHOM_GPS", {}});
  bus->publish(encodeSample(kNow, DepthSample{kNow, std::numeric_limits<double>::quiet_NaN()}));
  bus->publish(*encodeAcfrTwin(AttitudeSample{kNow, 1e9, 0, 0, true}, "sirius"));
  bus->publish(encodeSample(kNow, GyroSample{kNow, Eigen::Vector3d(0, 0, 11), {}}));
  bus->publish(encodeSample(kNow, GyroSample{kNow, {}, {}}));
  bus->publish(encodeSample(kNow, DepthSample{kNow - 11 * kSecond_ns, 3}));
  bus->publish(encodeSample(kNow, DepthSample{kNow + 11 * kSecond_ns, 3}));
  drain(source);
  EXPECT_TRUE(kept.samples.empty());
  EXPECT_EQ(counter(source, "bad"), 7u);
  EXPECT_EQ(counter(source, "stale"), 2u);
}

// Vehicle time is an hour ahead of the system's clock, by which another program stamps.
TEST_F(LcmSourceTest, StampsBySystemsUtcBecomeVehicleTimeWhereTheyDiffer) {
  constexpr std::int64_t kAhead = 3600 * kSecond_ns;
  for (const bool synchronised : {true, false}) {
    kept.samples.clear();
    auto own_bus = std::make_shared<LcmBus>("memq://");
    LcmSource source(
        everything(), own_bus, "sirius", [] { return kNow; },
        [synchronised] {
          return rt::ClockState{synchronised, kAhead};
        });
    own_bus->publish(encodeSample(kNow, DepthSample{kNow - kAhead - kSecond_ns, 3}));
    own_bus->publish(encodeSample(kNow, UsblFix{kNow - kAhead - 60 * kSecond_ns, kNow, -0.6, 2.0, 20, 1.5}));
    drain(source);
    ASSERT_EQ(kept.samples.size(), 2u) << synchronised;
    EXPECT_EQ(std::get<DepthSample>(kept.samples[0]).utc_ns, kNow - kSecond_ns);
    EXPECT_EQ(std::get<UsblFix>(kept.samples[1]).utc_ns, kNow - 60 * kSecond_ns);
    EXPECT_EQ(std::get<UsblFix>(kept.samples[1]).arrival_utc_ns, kNow);
    EXPECT_EQ(counter(source, "stale"), 0u);
  }
}

TEST_F(LcmSourceTest, AStampOfAnotherMachineIsTakenAsItIsOnlyWhileOwnUtcIsNotKnown) {
  bool synchronised = false;
  LcmSource source(
      everything(), bus, "sirius", [] { return kNow; },
      [&] {
        return rt::ClockState{synchronised, 3600 * kSecond_ns};
      });
  bus->publish(encodeSample(kNow, DepthSample{kNow - kSecond_ns, 3}));
  drain(source);
  ASSERT_EQ(kept.samples.size(), 1u);
  EXPECT_EQ(std::get<DepthSample>(kept.samples[0]).utc_ns, kNow - kSecond_ns);
  synchronised = true;
  bus->publish(encodeSample(kNow, DepthSample{kNow - kSecond_ns, 3}));
  drain(source);
  EXPECT_EQ(kept.samples.size(), 1u);
  EXPECT_EQ(counter(source, "stale"), 1u);
}

TEST_F(LcmSourceTest, AFloodIsHandledABoundedNumberAPoll) {
  LcmConfig config = everything();
  config.queue = 10;
  LcmSource source(config, bus, "sirius", [] { return kNow; });
  for (int i = 0; i < 25; ++i) bus->publish(encodeSample(kNow, DepthSample{kNow, 3}));
  ASSERT_TRUE(source.poll(0, kept));
  EXPECT_LE(kept.samples.size(), 10u);
}

int freeUdpPort() {
  const int socket = ::socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  socklen_t size = sizeof address;
  EXPECT_EQ(::bind(socket, reinterpret_cast<sockaddr*>(&address), size), 0);
  EXPECT_EQ(::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size), 0);
  ::close(socket);
  return ntohs(address.sin_port);
}

TEST(LcmUdp, ASampleCrossesBetweenTwoConnectionsOfOneMachine) {
  const std::string url = "udpm://239.255.76.67:" + std::to_string(freeUdpPort()) + "?ttl=0";
  const auto in = std::make_shared<LcmBus>(url), out = std::make_shared<LcmBus>(url);
  if (!in->isOpen() || !out->isOpen()) GTEST_SKIP() << "no multicast here: " << in->reason();
  LcmSource source(everything(), in, "sirius", [] { return kNow; });
  LcmPublisher publisher(out, "sirius");
  publisher.publish(PoseReport{});
  publisher.publish(encodeSample(kNow, DepthSample{kNow, 3}));
  Kept kept;
  for (int i = 0; i < 50 && kept.samples.empty(); ++i) ASSERT_TRUE(source.poll(100, kept));
  EXPECT_EQ(kept.samples.size(), 1u);
  EXPECT_EQ(publisher.published(), 3u);
}

// On a thread with a network of its own, with its only interface down: no bus can be joined until it is up.
TEST(LcmUdp, ABusThatCannotBeJoinedYetIsJoinedWhenTheNetworkIsThere) {
  bool own_network = false;
  std::thread([&] {
    own_network = ::unshare(CLONE_NEWNET) == 0;
    if (!own_network) return;
    auto bus = std::make_shared<LcmBus>("udpm://239.255.76.67:7667?ttl=0", 0);
    Kept kept;
    LcmSource source(everything(), bus, "sirius", [] { return kNow; });
    EXPECT_FALSE(source.poll(0, kept));
    EXPECT_FALSE(source.health().open);
    EXPECT_THAT(std::string(source.health().reason.view()), HasSubstr("cannot be opened"));
    EXPECT_FALSE(bus->publish(encodeSample(kNow, DepthSample{kNow, 3})));
    EXPECT_EQ(bus->refused(), 1u);
    ASSERT_EQ(std::system("ip link set lo up && ip route add 239.255.76.67/32 dev lo"), 0);
    ASSERT_TRUE(source.poll(0, kept));
    EXPECT_TRUE(source.health().open);
    EXPECT_EQ(source.health().disconnects, 0u);
    ASSERT_TRUE(bus->publish(encodeSample(kNow, DepthSample{kNow, 3})));
    for (int i = 0; i < 50 && kept.samples.empty(); ++i) ASSERT_TRUE(source.poll(100, kept));
    EXPECT_EQ(kept.samples.size(), 1u);
  }).join();
  if (!own_network) GTEST_SKIP() << "no network of its own: needs CAP_SYS_ADMIN";
}

TEST(LcmUdp, AnAddressThatCanNeverBeJoinedIsRefusedAtOnce) {
  for (const char* url : {"nonsense://", "udpm://ship:7667", "udpm://239.255.76.67:port",
                          "udpm://10.0.0.1:7667", "udpm://239.255.76.67:0", "udpm://239.255.76.67:99999"})
    EXPECT_THAT(refusal([&] { LcmBus bus(url); }), HasSubstr(std::string("LCM ") + url)) << url;
}

TEST(LcmUdp, AProviderThatCannotBeIsRefusedWithTheFix) {
  EXPECT_THAT(refusal([] { LcmBus bus("nonsense://"); }),
              HasSubstr("LCM nonsense://: cannot be opened; give udpm:"));
}

TEST(LcmConfig, TheListOfAcceptedSamplesIsReadWordByWord) {
  const auto read = [](const std::string& text) {
    const ConfigTable table = ConfigTable::parse(text, "onboard.toml");
    const LcmConfig config = readKeys(table.table("lcm"), LcmConfig{}, visitLcm);
    table.finish();
    return config;
  };
  const LcmConfig config = read("[lcm]\nurl = 'memq://'\naccept = 'depth  progress'\nmax_age_s = 3\n");
  EXPECT_EQ(config.url, "memq://");
  EXPECT_TRUE(config.accept[SensorSample(DepthSample{}).index()]);
  EXPECT_TRUE(config.accept[SensorSample(MissionProgressSample{}).index()]);
  EXPECT_EQ(std::count(config.accept.begin(), config.accept.end(), true), 2);
  EXPECT_THAT(refusal([&] { read("[lcm]\naccept = 'depth sonar'"); }), HasSubstr("'sonar' is none of dvl"));
  EXPECT_TRUE(read("").url.empty());
}

TEST(LcmConfig, PosesMayBeLeftOutByARateOfZero) {
  const auto rate = [](const std::string& hz) {
    const ConfigTable table = ConfigTable::parse("[lcm]\npublish_hz = " + hz, "onboard.toml");
    return readKeys(table.table("lcm"), LcmConfig{}, visitLcm).publish_hz;
  };
  EXPECT_EQ(rate("0"), 0);
  EXPECT_EQ(rate("100"), 100);
  for (const char* wrong : {"-0.1", "100.5"})
    EXPECT_THAT(refusal([&] { (void)rate(wrong); }), HasSubstr("publish_hz")) << wrong;
}

// As other programs read it: by the decoder of lcm-gen.

}  // namespace
}  // namespace fathom::io
