// PD4, PD5 and PD6: ensembles built byte by byte from the guide's tables, and lines in its form.
#include <gmock/gmock.h>

#include <random>

#include "firmware_if/devices/dvl/dvl_sample.hpp"
#include "firmware_if/devices/dvl/dvl_source.hpp"
#include "firmware_if/devices/dvl/pd45_decoder.hpp"
#include "firmware_if/devices/dvl/pd6_decoder.hpp"
#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/units.hpp"
#include "tests/firmware_if/pd0_builder.hpp"

namespace fathom::io {
namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr std::int64_t kDay = 86'400 * kSecond_ns;
constexpr std::int64_t kMidnight = 19'700 * kDay;

struct Pd45Builder {
  bool pd5 = false;
  std::uint8_t frame = 2;                                      // ship
  std::array<std::int16_t, 4> velocity = {100, 1500, -20, 3};  // starboard, forward, up [mm/s]
  std::array<std::uint16_t, 4> range = {200, 210, 220, 230};   // [cm]
  std::array<std::uint8_t, 4> time = {11, 56, 36, 44};
  std::uint16_t sound_speed = 1524;
  std::int16_t pitch = 0, roll = 0;  // [0.01 deg]
  std::uint16_t heading = 0;

  [[nodiscard]] Bytes bytes() const {
    Bytes b(pd5 ? 88 : 47);
    const auto put = [&](std::size_t byte, std::uint16_t value) {  // bytes count from 1, as in the guide
      writeLittleEndian(std::span(b).subspan(byte - 1, 2), value);
    };
    b[0] = 0x7D;
    b[1] = pd5 ? 1 : 0;
    put(3, static_cast<std::uint16_t>(b.size() - 2));
    b[4] = static_cast<std::uint8_t>(frame << 6 | 0x20);
    for (std::size_t i = 0; i < 4; ++i) {
      put(6 + 2 * i, static_cast<std::uint16_t>(velocity[i]));
      put(14 + 2 * i, range[i]);
      b[35 + i] = time[i];
    }
    put(42, sound_speed);
    put(44, 2100);
    if (pd5) {
      put(49, static_cast<std::uint16_t>(pitch));
      put(51, static_cast<std::uint16_t>(roll));
      put(53, heading);
    }
    std::uint32_t sum = 0;
    for (const std::uint8_t byte : b) sum += byte;
    put(b.size() - 1, static_cast<std::uint16_t>(sum));
    return b;
  }
};

template <class Decoder>
std::vector<Pd45Ensemble> decodeAll(Decoder& decoder, std::span<const std::uint8_t> bytes,
                                    std::size_t piece) {
  std::vector<Pd45Ensemble> out;
  while (!bytes.empty()) {
    auto part = bytes.first(std::min(piece, bytes.size()));
    bytes = bytes.subspan(part.size());
    do {
      part = part.subspan(decoder.accept(part));
      while (const Pd45Ensemble* found = decoder.next()) out.push_back(*found);
    } while (!part.empty());
  }
  return out;
}

TEST(Pd45, FieldsStandWhereTheGuideHasThem) {
  for (const bool pd5 : {false, true}) {
    Pd45Builder builder{.pd5 = pd5, .pitch = 150, .roll = -250, .heading = 12345};
    Pd45Decoder decoder;
    const auto found = decodeAll(decoder, builder.bytes(), 1000);
    ASSERT_EQ(found.size(), 1u);
    const Pd45Ensemble& e = found[0];
    EXPECT_EQ(e.pd5, pd5);
    EXPECT_EQ(e.frame, Pd0Frame::kShip);
    EXPECT_TRUE(e.tilts_used);
    EXPECT_EQ(e.velocity[1], 1.5);
    EXPECT_EQ(e.velocity[3], 0.003);
    EXPECT_EQ(e.range[0], 2.0);
    EXPECT_EQ(e.range[3], 2.3);
    EXPECT_EQ(e.time_of_day_ns, ((11 * 60 + 56) * 60 + 36) * kSecond_ns + 440'000'000);
    EXPECT_EQ(e.sound_speed, 1524);
    EXPECT_EQ(e.temperature_c, 21);
    EXPECT_EQ(e.pitch_deg.has_value(), pd5);
    if (pd5) {
      EXPECT_EQ(e.pitch_deg, 1.5);
      EXPECT_EQ(e.roll_deg, -2.5);
      EXPECT_EQ(e.heading_deg, 123.45);
    }
  }
}

TEST(Pd45, VelocityIsTheInstrumentsOwnForwardStarboardDown) {
  for (const std::uint8_t frame : {1, 2}) {
    Pd45Builder builder{.frame = frame};
    Pd45Decoder decoder;
    const auto found = decodeAll(decoder, builder.bytes(), 1000);
    ASSERT_EQ(found.size(), 1u);
    const auto sample = toDvlSample(toPd0(found[0], kMidnight));
    ASSERT_TRUE(sample && sample->velocity);
    EXPECT_TRUE(sample->velocity->isApprox(Eigen::Vector3d(1.5, 0.1, 0.02))) << sample->velocity->transpose();
    EXPECT_EQ(sample->sound_speed, 1524);
    EXPECT_FALSE(sample->altitude) << "PD4 does not say how the beams are tilted";
  }
}

TEST(Pd45, EarthVelocityIsTurnedBackByPd5sAttitudeAndAbsentInPd4) {
  Pd45Builder builder{.frame = 3};
  builder.velocity = {1000, 0, 0, 0};  // east
  builder.heading = 9000;
  builder.pd5 = true;
  Pd45Decoder decoder;
  auto found = decodeAll(decoder, builder.bytes(), 1000);
  ASSERT_EQ(found.size(), 1u);
  const auto sample = toDvlSample(toPd0(found[0], kMidnight));
  ASSERT_TRUE(sample && sample->velocity);
  EXPECT_TRUE(sample->velocity->isApprox(Eigen::Vector3d(1, 0, 0), 1e-9)) << "heading east, going east";
  ASSERT_TRUE(sample->altitude);
  EXPECT_NEAR(*sample->altitude, 2.15, 0.01);
  builder.pd5 = false;
  found = decodeAll(decoder, builder.bytes(), 1000);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_FALSE(toDvlSample(toPd0(found[0], kMidnight))->velocity);
}

TEST(Pd45, TheDayIsTheOneNearest) {
  Pd45Ensemble e;
  e.time_of_day_ns = 23 * 3600 * kSecond_ns + 3599 * kSecond_ns;  // a second before midnight
  EXPECT_EQ(toPd0(e, kMidnight + kSecond_ns).utc_ns, kMidnight - kSecond_ns);
  EXPECT_EQ(toPd0(e, kMidnight - 2 * kSecond_ns).utc_ns, kMidnight - kSecond_ns);
  e.time_of_day_ns = kSecond_ns;
  EXPECT_EQ(toPd0(e, kMidnight - kSecond_ns).utc_ns, kMidnight + kSecond_ns);
  e.time_of_day_ns.reset();
  EXPECT_FALSE(toPd0(e, kMidnight).utc_ns);
}

TEST(Pd45, AbsentIsNeverANumber) {
  Pd45Builder builder{.velocity = {-32768, -32768, -32768, -32768},
                      .range = {0, 210, 0, 0},
                      .time = {24, 0, 0, 0},
                      .sound_speed = 0};
  Pd45Decoder decoder;
  const auto found = decodeAll(decoder, builder.bytes(), 1000);
  ASSERT_EQ(found.size(), 1u);
  for (const auto& velocity : found[0].velocity) EXPECT_FALSE(velocity);
  EXPECT_FALSE(found[0].range[0]);
  EXPECT_FALSE(found[0].time_of_day_ns);
  EXPECT_FALSE(found[0].sound_speed);
}

TEST(Pd45, EnsemblesAmongNoiseAreFoundHoweverTheBytesAreCut) {
  std::mt19937 random(4);
  Bytes stream;
  for (int i = 0; i < 60; ++i) {
    for (std::size_t k = random() % 80; k > 0; --k)
      stream.push_back(random() % 5 == 0 ? 0x7D : static_cast<std::uint8_t>(random()));
    Pd45Builder builder{.pd5 = i % 2 == 0, .sound_speed = static_cast<std::uint16_t>(1400 + i)};
    Bytes bytes = builder.bytes();
    if (i % 10 == 9) bytes[20] ^= 0x10;
    stream.insert(stream.end(), bytes.begin(), bytes.end());
  }
  for (const std::size_t piece : {1U, 3U, 88U, 5000U}) {
    Pd45Decoder decoder;
    const auto found = decodeAll(decoder, stream, piece);
    ASSERT_EQ(found.size(), 54u) << piece;
    EXPECT_EQ(found[53].sound_speed, 1458);
    EXPECT_GE(decoder.counts().bad_checksum, 6u);
    EXPECT_GT(decoder.counts().resynced, 0u);
  }
}

constexpr std::string_view kPd6 =
    ":SA, -2.31, +1.92, 75.20\r\n"
    ":TS,04081111563644,35.0,+21.0,   0.0,1524.0,  0\r\n"
    ":WI, -2967,  -496,   -75,  +188,A\r\n"
    ":WS, -2957,  -496,   -75,A\r\n"
    ":WE, -1230, -2713,   -75,A\r\n"
    ":WD,       +0.00,       +0.00,       +0.00, 20.00,  0.00\r\n"
    ":BI,   +24,  +500,   -20,    -4,A\r\n"
    ":BS,   -13,   +22,   -20,A\r\n"
    ":BE,   +17,   +18,   -20,A\r\n"
    ":BD,       +0.00,       +0.00,       +0.00, 10.25,  0.00\r\n";

std::vector<Pd6Ensemble> decodeText(Pd6Decoder& decoder, std::string_view text) {
  std::vector<Pd6Ensemble> out;
  for (const char c : text)
    if (decoder.push(static_cast<std::uint8_t>(c))) out.push_back(decoder.ensemble());
  return out;
}

std::string with(std::string_view from, std::string_view to) {
  std::string text(kPd6);
  return text.replace(text.find(from), from.size(), to);
}

TEST(Pd6, AnEnsemblesLinesBecomeOneSample) {
  Pd6Decoder decoder;
  const auto found = decodeText(decoder, kPd6);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].utc_ns, *utcFromCivil({2004, 8, 11, 11, 56, 36, 440'000'000}));
  const DvlSample& sample = found[0].sample;
  ASSERT_TRUE(sample.velocity);
  EXPECT_TRUE(sample.velocity->isApprox(Eigen::Vector3d(0.5, 0.024, 0.02)));
  EXPECT_EQ(sample.altitude, 10.25);
  EXPECT_EQ(sample.sound_speed, 1524);
  EXPECT_EQ(sample.utc_ns, found[0].utc_ns);
  EXPECT_EQ(decoder.counts().bad_lines, 0u);
  EXPECT_EQ(decoder.counts().skipped_bytes, 0u);
}

TEST(Pd6, TheShipsFrameServesWhereThereIsNoInstrumentsLine) {
  Pd6Decoder decoder;
  const auto found = decodeText(decoder, with(":BI,   +24,  +500,   -20,    -4,A\r\n", ""));
  ASSERT_EQ(found.size(), 1u);
  ASSERT_TRUE(found[0].sample.velocity);
  EXPECT_TRUE(found[0].sample.velocity->isApprox(Eigen::Vector3d(0.022, -0.013, 0.02)));
}

TEST(Pd6, BadVelocityIsAbsentAndTakesTheOldRangeWithIt) {
  for (const std::string_view bad : {"   +24,  +500,   -20,    -4,V", "-32768,-32768,-32768,-32768,A"}) {
    Pd6Decoder decoder;
    const auto found = decodeText(decoder, with("   +24,  +500,   -20,    -4,A", bad));
    ASSERT_EQ(found.size(), 1u);
    EXPECT_FALSE(found[0].sample.velocity);
    EXPECT_FALSE(found[0].sample.altitude);
  }
  Pd6Decoder decoder;
  const auto found = decodeText(decoder, with(" 10.25", "  0.00"));
  ASSERT_EQ(found.size(), 1u);
  EXPECT_FALSE(found[0].sample.altitude);
}

TEST(Pd6, LinesThatMakeNoSenseAreCountedAndLoseTheirValueOnly) {
  for (const auto& [from, to] : std::vector<std::pair<std::string_view, std::string_view>>{
           {"04081111563644", "04131111563644"},
           {"04081111563644", "0408111156364"},
           {"  +500", " +5x00"},
           {"  +500", "+99999"},
           {"  +500", "   nan"},
           {"    -4,A", "    -4,Q"},
           {"    -4,A", "    -4"},
           {" 10.25", " -1.00"},
           {" 10.25,  0.00", " 10.25,  0.00,1,2,3,4,5,6"}}) {
    Pd6Decoder decoder;
    const auto found = decodeText(decoder, with(from, to));
    ASSERT_EQ(found.size(), 1u) << to;
    EXPECT_EQ(decoder.counts().bad_lines, 1u) << to;
  }
}

TEST(Pd6, NoiseAndCutLinesCostOnlyTheirEnsemble) {
  std::string text = "\xFF\x01noise:SA,+1";
  text += kPd6;
  text += kPd6.substr(0, 120);  // cut in the middle
  text += kPd6;
  text += std::string(500, ':') + std::string(300, 'x');
  text += kPd6;
  Pd6Decoder decoder;
  EXPECT_EQ(decodeText(decoder, text).size(), 3u);
  EXPECT_GT(decoder.counts().skipped_bytes, 300u);
  // Only water lines between the ends say nothing.
  EXPECT_TRUE(decodeText(decoder, ":BD,       +0.00,       +0.00,       +0.00, 10.25,  0.00\r\n").empty());
}

// Hands the source one text or packet a read.
class OneRead final : public ByteStream {
 public:
  explicit OneRead(std::vector<Bytes> reads) : reads_(std::move(reads)) {}
  std::size_t read(std::span<std::uint8_t> buffer, int) noexcept override {
    if (at_ == reads_.size()) return 0;
    const Bytes& bytes = reads_[at_++];
    std::copy(bytes.begin(), bytes.end(), buffer.begin());
    return bytes.size();
  }
  bool isOpen() const noexcept override { return true; }
  std::uint64_t disconnects() const noexcept override { return 0; }

 private:
  std::vector<Bytes> reads_;
  std::size_t at_ = 0;
};

struct Count final : SampleSink {
  void sample(std::int64_t, const SensorSample& s) noexcept override {
    last = std::get<DvlSample>(s), ++samples;
  }
  void raw(std::int64_t, std::string_view, std::span<const std::uint8_t> bytes) noexcept override {
    raw_bytes += bytes.size();
  }
  DvlSample last;
  std::size_t samples = 0, raw_bytes = 0;
};

TEST(DvlSource, TheFormatIsRecognisedByItsFirstEnsembleAndAgainAfterASilence) {
  using Format = DvlConfig::Format;
  Pd45Builder pd4, pd5;
  pd5.pd5 = true;
  const Bytes text(kPd6.begin(), kPd6.end());
  for (const auto& [format, bytes] :
       std::vector<std::pair<Format, Bytes>>{{Format::kPd0, test::Pd0Builder{}.bytes()},
                                             {Format::kPd4, pd4.bytes()},
                                             {Format::kPd5, pd5.bytes()},
                                             {Format::kPd6, text}}) {
    std::int64_t now = kMidnight;
    DvlSource source(
        {}, [&now] { return now; }, std::make_unique<OneRead>(std::vector<Bytes>{{1, 2, 3}, bytes, bytes}));
    Count sink;
    source.poll(0, sink);
    EXPECT_EQ(source.format(), format);
    EXPECT_EQ(sink.samples, 2u);
    EXPECT_EQ(sink.raw_bytes, 2 * bytes.size());
    EXPECT_TRUE(sink.last.velocity);
    now += 100 * kSecond_ns;
    source.poll(0, sink);
    EXPECT_EQ(source.format(), Format::kAuto);
  }
}

TEST(DvlSource, AConfiguredFormatReadsNothingElse) {
  const Bytes text(kPd6.begin(), kPd6.end());
  DvlConfig config{.device = {}, .format = DvlConfig::Format::kPd0};
  DvlSource source(
      config, [] { return kMidnight; }, std::make_unique<OneRead>(std::vector<Bytes>{text}));
  Count sink;
  source.poll(0, sink);
  EXPECT_EQ(sink.samples, 0u);
}

}  // namespace
}  // namespace fathom::io
