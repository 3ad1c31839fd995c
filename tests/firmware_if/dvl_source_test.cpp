#include "firmware_if/devices/dvl/dvl_source.hpp"

#include <gmock/gmock.h>

#include <deque>
#include <random>
#include <thread>

#include "realtime/base/units.hpp"
#include "tests/firmware_if/pd0_builder.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/support/pty_line.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

using test::refusal, ::testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;

constexpr std::int64_t kFirstPing_ns = 1'700'000'000 * kSecond_ns;

// Keeps what a source gives; takes no memory while there is room.
struct Kept final : SampleSink {
  Kept() { samples.reserve(4096), arrivals.reserve(4096); }
  void sample(std::int64_t arrival_utc_ns, const SensorSample& sample) noexcept override {
    samples.push_back(std::get<DvlSample>(sample));
    arrivals.push_back(arrival_utc_ns);
  }
  void raw(std::int64_t, std::string_view source, std::span<const std::uint8_t> bytes) noexcept override {
    EXPECT_EQ(source, "RAW_DVL");
    ++raw_entries;
    raw_bytes += bytes.size();
  }
  std::vector<DvlSample> samples;
  std::vector<std::int64_t> arrivals;
  std::size_t raw_entries = 0, raw_bytes = 0;
};

std::uint64_t counter(const DvlSource& source, std::string_view name) {
  for (const auto& [known, value] : source.health().counters)
    if (known == name) return value;
  ADD_FAILURE() << "no counter " << name;
  return 0;
}

// An ensemble with the builder's clock at `utc_ns`.
Bytes ensembleAt(std::int64_t utc_ns, std::uint32_t number = 1) {
  test::Pd0Builder builder;
  builder.number = number;
  builder.setClock(utc_ns);
  return builder.bytes();
}

// Bytes that a test says, at times that it says.
struct Script {
  std::int64_t now = kFirstPing_ns;
  std::deque<Bytes> reads;
  bool open = true;
};
class ScriptStream final : public ByteStream {
 public:
  explicit ScriptStream(Script& script) : script_(script) {}
  std::size_t read(std::span<std::uint8_t> buffer, int) noexcept override {
    if (script_.reads.empty()) return 0;
    const Bytes bytes = std::move(script_.reads.front());
    script_.reads.pop_front();
    std::copy(bytes.begin(), bytes.end(), buffer.begin());
    return bytes.size();
  }
  bool isOpen() const noexcept override { return script_.open; }
  std::uint64_t disconnects() const noexcept override { return 0; }

 private:
  Script& script_;
};
DvlSource scripted(Script& script, const DvlConfig& config) {
  return {config, [&script] { return script.now; }, std::make_unique<ScriptStream>(script)};
}

TEST(DvlSource, StampsAreTheInstrumentsClockInVehicleTime) {
  Script script;
  DvlSource source = scripted(script, {.device = {}, .latency_s = 0.1});
  Kept kept;
  std::mt19937 random(3);
  for (int i = 0; i < 400; ++i) {
    const std::int64_t ping = kFirstPing_ns + i * kSecond_ns / 7;
    script.now = ping + kSecond_ns / 10 + static_cast<std::int64_t>(random() % 30'000'000);
    // Its clock is 90 s fast.
    script.reads.push_back(ensembleAt(ping + 90 * kSecond_ns));
    EXPECT_TRUE(source.poll(0, kept));
    ASSERT_EQ(kept.samples.size(), static_cast<std::size_t>(i) + 1);
    EXPECT_EQ(kept.arrivals.back(), script.now);
    if (i > 35) {
      EXPECT_NEAR(static_cast<double>(kept.samples.back().utc_ns - ping) / 1e9, 0, 0.016);
    }
  }
  EXPECT_NEAR(source.clock().offset(), -90, 0.016);
  EXPECT_EQ(counter(source, "clock_leaps"), 0u);
}

TEST(DvlSource, ByArrivalTheFirstByteCountsLessTheLatency) {
  Script script;
  DvlSource source = scripted(script, {.device = {}, .clock = DvlConfig::Clock::kArrival, .latency_s = 0.25});
  Kept kept;
  Bytes bytes = ensembleAt(kFirstPing_ns);
  const Bytes garbage(100, 0x55);
  script.reads.push_back(garbage);
  source.poll(0, kept);
  script.now = kFirstPing_ns + 2 * kSecond_ns;
  script.reads.push_back(Bytes(bytes.begin(), bytes.begin() + 40));
  source.poll(0, kept);
  script.now += kSecond_ns / 20;
  script.reads.push_back(Bytes(bytes.begin() + 40, bytes.end()));
  source.poll(0, kept);
  ASSERT_EQ(kept.samples.size(), 1u);
  EXPECT_EQ(kept.samples[0].utc_ns, kFirstPing_ns + 2 * kSecond_ns - kSecond_ns / 4);
  EXPECT_EQ(kept.arrivals[0], script.now);
  EXPECT_EQ(kept.raw_bytes, bytes.size());
  EXPECT_EQ(counter(source, "skipped_bytes"), garbage.size());
  EXPECT_EQ(counter(source, "resynced"), 1u);
}

TEST(DvlSource, EnsemblesWithoutBottomTrackAreKeptRawAndCounted) {
  Script script;
  DvlSource source = scripted(script, {});
  Kept kept;
  test::Pd0Builder builder;
  builder.bottom_track = false;
  script.reads.push_back(builder.bytes());
  source.poll(0, kept);
  EXPECT_TRUE(kept.samples.empty());
  EXPECT_EQ(kept.raw_entries, 1u);
  EXPECT_EQ(counter(source, "no_bottom_track"), 1u);
  builder.bottom_track = true;
  builder.velocity = {-32768, -32768, -32768, -32768};
  script.reads.push_back(builder.bytes());
  source.poll(0, kept);
  ASSERT_EQ(kept.samples.size(), 1u);
  EXPECT_FALSE(kept.samples[0].velocity);
  EXPECT_EQ(counter(source, "no_velocity"), 1u);
}

TEST(DvlSource, SilenceIsCountedOnceAndDamageByItsKind) {
  Script script;
  DvlSource source = scripted(script, {.device = {}, .silence_s = 2});
  Kept kept;
  for (int i = 0; i < 100; ++i) {
    script.now += kSecond_ns / 10;
    source.poll(0, kept);
  }
  EXPECT_EQ(counter(source, "silences"), 1u);
  Bytes bad = ensembleAt(script.now);
  bad[60] ^= 1;
  script.reads.push_back(bad);
  script.reads.push_back(ensembleAt(script.now));
  source.poll(0, kept);
  EXPECT_EQ(kept.samples.size(), 1u);
  EXPECT_EQ(counter(source, "bad_checksum"), 1u);
  EXPECT_EQ(source.health().last_data_ns, script.now);
  script.now += 3 * kSecond_ns;
  source.poll(0, kept);
  EXPECT_EQ(counter(source, "silences"), 2u);
}

TEST(DvlSource, TakesNoMemoryOnceItHasRun) {
  test::PtyLine line;
  DvlSource source({.device = "serial:" + line.name() + ":115200"}, [] { return kFirstPing_ns; });
  Kept kept;
  DeviceHealth health = source.health();
  const Bytes bytes = ensembleAt(kFirstPing_ns);
  line.send(bytes);
  source.poll(1000, kept);
  const auto before = test::threadCost();
  for (int i = 0; i < 50; ++i) {
    line.send(bytes);
    while (kept.samples.size() < static_cast<std::size_t>(i) + 2) source.poll(1000, kept);
    health = source.health();
  }
  const auto cost = test::threadCost() - before;
  EXPECT_EQ(health.samples, 51u);
  EXPECT_EQ(cost.heap_calls, 0u);
}

TEST(DvlSource, ALineAtItsRealRateWithGarbageAndAPulledCableLosesOnlyWhatWasDamaged) {
  test::PtyLine line;
  DvlSource source({.device = "serial:" + line.name() + ":115200"}, [] {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(
               std::chrono::steady_clock::now().time_since_epoch())
        .count();
  });
  Kept kept;
  std::mt19937 random(5);
  const auto garbage = [&](std::size_t size) {
    Bytes bytes(size);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
    return bytes;
  };
  // Eight ensembles a second, some with noise before them, one cut in two in the middle.
  const auto pause = [] { std::this_thread::sleep_for(std::chrono::milliseconds(125)); };
  std::size_t sent = 0;
  for (int i = 0; i < 8; ++i) {
    if (i % 3 == 1) line.send(garbage(400));
    const Bytes bytes = ensembleAt(kFirstPing_ns + i * kSecond_ns / 8, static_cast<std::uint32_t>(i));
    if (i == 4) {
      line.send({bytes.data(), bytes.size() / 2});
      pause();
      source.poll(0, kept);
      line.send({bytes.data() + bytes.size() / 2, bytes.size() - bytes.size() / 2});
    } else {
      line.send(bytes);
    }
    ++sent;
    pause();
    EXPECT_TRUE(source.poll(10, kept));
  }
  // Noise that looks like a header can hold the decoder up until its length has come.
  for (int i = 0; kept.samples.size() < sent && i < 20; ++i) {
    line.send(ensembleAt(kFirstPing_ns + 2 * kSecond_ns, 100));
    ++sent;
    source.poll(100, kept);
  }
  EXPECT_EQ(kept.samples.size(), sent);
  const Bytes half = ensembleAt(kFirstPing_ns);
  line.send({half.data(), 50});
  source.poll(100, kept);
  line.unplug();
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(source.poll(1, kept));
  EXPECT_EQ(source.health().disconnects, 1u);
  EXPECT_FALSE(source.health().open);
  line.plug();
  line.send(ensembleAt(kFirstPing_ns));
  for (int i = 0; i < 40 && kept.samples.size() == sent; ++i) source.poll(100, kept);
  EXPECT_EQ(kept.samples.size(), sent + 1) << "opened again within a second";
  EXPECT_TRUE(source.health().open);
}

TEST(DvlSource, ARealDiveComesThroughAFileAsThroughTheDecoder) {
  FATHOM_REQUIRE_DATA("dvl/adcp.adc");
  DvlSource source({.device = "file:" + test::dataFile("dvl/adcp.adc").string()},
                   [] { return kFirstPing_ns; });
  Kept kept;
  while (source.poll(0, kept)) continue;
  // As data/README.md has it from independent decoders.
  EXPECT_EQ(counter(source, "ensembles"), 4132u);
  std::size_t with_velocity = 0;
  for (const DvlSample& sample : kept.samples) with_velocity += sample.velocity ? 1 : 0;
  EXPECT_EQ(with_velocity, 3535u);
  EXPECT_EQ(kept.raw_entries, 4132u);
}

TEST(DvlConfig, KeysAreReadAndNonsenseIsRefused) {
  const auto read = [](const std::string& text) {
    const ConfigTable table = ConfigTable::parse(text, "onboard.toml");
    const DvlConfig config = readKeys(table.table("dvl"), DvlConfig{}, visitDvl);
    table.finish();
    return config;
  };
  const DvlConfig config = read(
      "[dvl]\ndevice = 'serial:/dev/ttyS1:115200'\nformat = 'pd6'\nclock = 'arrival'\nlatency_s = 0.3\n"
      "silence_s = 4");
  EXPECT_EQ(config.device, "serial:/dev/ttyS1:115200");
  EXPECT_EQ(config.format, DvlConfig::Format::kPd6);
  EXPECT_EQ(config.clock, DvlConfig::Clock::kArrival);
  EXPECT_EQ(config.latency_s, 0.3);
  EXPECT_EQ(config.silence_s, 4);
  EXPECT_TRUE(read("").device.empty());
  EXPECT_THAT(refusal([&] { read("[dvl]\ndevice = 'ttyS1'"); }), HasSubstr("give udp:HOST:PORT or serial:"));
  EXPECT_THAT(refusal([&] { read("[dvl]\ndevice = 'serial:/dev/ttyS1:9601'"); }),
              HasSubstr("9601 baud is not one of 300"));
  EXPECT_THAT(refusal([&] { read("[dvl]\nformat = 'pd3'"); }), HasSubstr("format"));
  EXPECT_THAT(refusal([&] { read("[dvl]\nbaud = 9600"); }), HasSubstr("baud"));
  EXPECT_THAT(refusal([] { DvlSource({.device = "file:/absent.pd0"}, [] { return kFirstPing_ns; }); }),
              HasSubstr("/absent.pd0"));
}

}  // namespace
}  // namespace fathom::io
