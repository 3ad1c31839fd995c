// The real NMEA 2000 captures against what canboat's analyzer said of them.
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "firmware_if/devices/can/can_text.hpp"
#include "firmware_if/devices/can/n2k_decoder.hpp"
#include "firmware_if/devices/can/n2k_definitions.hpp"
#include "realtime/base/units.hpp"
#include "tests/support/program_run.hpp"

namespace fathom::io {
namespace {

using nlohmann::json;

std::vector<json> runJson(const std::filesystem::path& file) {
  std::vector<json> lines;
  const test::Outcome run = test::runProgram("fathom-sensors can " + file.string() + " --json");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  for (const std::string& line : test::linesOf(run.out)) lines.push_back(json::parse(line));
  return lines;
}

// A field as canboat prints it: its name, our units per canboat's, and half of its last printed digit
// [canboat units].
struct CanboatField {
  const char* name;
  double scale = 1;
  double rounding = 1e-9;
};
constexpr CanboatField degrees(const char* name) {
  return {name, kRadiansPerDegree, 0.05};
}

// All fields of the decoders that can occur in the capture; a name that is not here fails the test.
const std::map<int, std::map<std::string, CanboatField>>& canboatNames() {
  static const std::map<int, std::map<std::string, CanboatField>> kNames = {
      {127245,
       {{"instance", {"Instance"}},
        {"angle_order_rad", degrees("Angle Order")},
        {"position_rad", degrees("Position")}}},
      {127250,
       {{"sid", {"SID"}},
        {"heading_rad", degrees("Heading")},
        {"deviation_rad", degrees("Deviation")},
        {"variation_rad", degrees("Variation")},
        {"reference", {"Reference"}}}},
      {127251, {{"sid", {"SID"}}, {"rate_of_turn_radps", {"Rate", kRadiansPerDegree, 0.5e-6}}}},
      {127257,
       {{"sid", {"SID"}},
        {"yaw_rad", degrees("Yaw")},
        {"pitch_rad", degrees("Pitch")},
        {"roll_rad", degrees("Roll")}}},
      {128259,
       {{"sid", {"SID"}},
        {"water_speed_mps", {"Speed Water Referenced"}},
        {"ground_speed_mps", {"Speed Ground Referenced"}},
        {"water_speed_type", {"Speed Water Referenced Type"}}}},
      {128267, {{"sid", {"SID"}}, {"depth_m", {"Depth"}}, {"offset_m", {"Offset"}}, {"range_m", {"Range"}}}},
      {128275,
       {{"days_since_1970", {"Date"}},
        {"time_of_day_s", {"Time"}},
        {"log_m", {"Log"}},
        {"trip_log_m", {"Trip Log"}}}},
      {129025, {{"latitude_deg", {"Latitude"}}, {"longitude_deg", {"Longitude"}}}},
      {129026,
       {{"sid", {"SID"}},
        {"cog_reference", {"COG Reference"}},
        {"cog_rad", degrees("COG")},
        {"sog_mps", {"SOG"}}}},
      {130306,
       {{"sid", {"SID"}},
        {"wind_speed_mps", {"Wind Speed"}},
        {"wind_angle_rad", degrees("Wind Angle")},
        {"reference", {"Reference"}}}},
      {130311,
       {{"sid", {"SID"}},
        {"temperature_source", {"Temperature Source"}},
        {"temperature_c", {"Temperature"}},
        {"humidity_percent", {"Humidity"}},
        {"atmospheric_pressure_pa", {"Atmospheric Pressure"}}}},
  };
  return kNames;
}

// "Magnetic" or "Sea Temperature" against "magnetic" or "sea".
bool sameName(std::string theirs, const std::string& ours) {
  for (char& c : theirs) c = c == ' ' ? '_' : static_cast<char>(std::tolower(c));
  return theirs.rfind(ours, 0) == 0;
}

TEST(CanCapture, EveryDecodeOfTheSampleAgreesWithCanboats) {
  FATHOM_REQUIRE_DATA("can/candumpSample3.txt");
  FATHOM_REQUIRE_DATA("can/candumpSample3.json");
  const std::vector<json> ours = runJson(test::dataFile("can/candumpSample3.txt"));

  std::vector<json> theirs;
  std::ifstream in(test::dataFile("can/candumpSample3.json"));
  for (std::string line; std::getline(in, line);) {
    const json message = json::parse(line);
    if (message.contains("pgn") && findN2kPgn(message["pgn"].get<std::uint32_t>()) != nullptr)
      theirs.push_back(message);
  }
  ASSERT_EQ(ours.size(), theirs.size());

  std::map<int, int> counts;
  for (std::size_t i = 0; i < ours.size(); ++i) {
    const json& a = ours[i];
    const json& b = theirs[i];
    const int pgn = a["pgn"];
    ++counts[pgn];
    ASSERT_EQ(pgn, b["pgn"]) << "message " << i;
    EXPECT_EQ(a["source"], b["src"]);
    // canboat prints UTC to the millisecond; both end in seconds and milliseconds.
    const auto milliseconds = static_cast<long long>(a["time_s"].get<double>() * 1000) % 60'000;
    const std::string stamp = b["timestamp"];
    EXPECT_NEAR(static_cast<double>(milliseconds), std::stod(stamp.substr(17, 6)) * 1000, 1.0 + 1e-6)
        << stamp;

    ASSERT_TRUE(canboatNames().contains(pgn)) << pgn;
    for (const auto& [name, field] : canboatNames().at(pgn)) {
      const bool here = a["fields"].contains(name);
      ASSERT_EQ(here, b["fields"].contains(field.name)) << pgn << " " << name << " in\n" << a << "\n" << b;
      if (!here) continue;
      const json& mine = a["fields"][name];
      json expected = b["fields"][field.name];
      if (mine.is_string()) {
        EXPECT_TRUE(sameName(expected["name"], mine)) << expected << " " << mine;
        continue;
      }
      if (expected.is_object()) expected = expected["value"];
      EXPECT_NEAR(mine.get<double>() / field.scale, expected.get<double>(), field.rounding * (1 + 1e-6))
          << pgn << " " << name << "\n"
          << a << "\n"
          << b;
    }
    for (const auto& [name, value] : a["fields"].items())
      EXPECT_TRUE(canboatNames().at(pgn).contains(name)) << pgn << " " << name << " is not checked";
  }
  EXPECT_EQ(counts[127250], 175);
  EXPECT_EQ(counts[127251], 175);
  EXPECT_EQ(counts[127257], 175);
  EXPECT_EQ(counts[128267], 17);
  EXPECT_EQ(counts[129025], 165);
}

// canboat's own form of frames and messages: time,priority,pgn,source,destination,size,byte,byte,...
struct CanboatRow {
  N2kId id;
  std::vector<std::uint8_t> bytes;
};
std::vector<CanboatRow> readCanboatRows(const std::filesystem::path& path) {
  std::vector<CanboatRow> rows;
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    if (line.find_first_not_of(" \r") == std::string::npos || line[0] == '#') continue;
    std::vector<std::string> words;
    std::istringstream text(line);
    for (std::string word; std::getline(text, word, ',');) words.push_back(word);
    CanboatRow row;
    row.id.pgn = static_cast<std::uint32_t>(std::stoul(words.at(2)));
    row.id.source = static_cast<std::uint8_t>(std::stoul(words.at(3)));
    row.id.destination = static_cast<std::uint8_t>(std::stoul(words.at(4)));
    for (std::size_t i = 6; i < words.size(); ++i)
      row.bytes.push_back(static_cast<std::uint8_t>(std::stoul(words[i], nullptr, 16)));
    rows.push_back(row);
  }
  return rows;
}

TEST(CanCapture, TheGnssPositionAgreesWithCanboats) {
  FATHOM_REQUIRE_DATA("can/pgn-test.in");
  for (const CanboatRow& row : readCanboatRows(test::dataFile("can/pgn-test.in"))) {
    N2kMessage message;
    if (row.id.pgn == 129029) {
      ASSERT_TRUE(decodeN2kPayload(row.id.pgn, row.bytes, message));
      EXPECT_NEAR(*message.number("latitude_deg"), 52.7461333, 0.5e-7);
      EXPECT_NEAR(*message.number("longitude_deg"), 5.1815566, 0.5e-7);
      EXPECT_DOUBLE_EQ(*message.number("altitude_m"), 3.4);
      EXPECT_DOUBLE_EQ(*message.number("time_of_day_s"), 6 * 3600 + 25 * 60 + 12);
      EXPECT_DOUBLE_EQ(*message.number("days_since_1970"), 15089);  // 2011-04-25
      EXPECT_DOUBLE_EQ(*message.number("satellites"), 9);
      EXPECT_DOUBLE_EQ(*message.number("hdop"), 0.9);
      EXPECT_DOUBLE_EQ(*message.number("pdop"), 1.4);
      EXPECT_FALSE(message.number("geoidal_separation_m")) << "7fffffff is not available";
    }
    if (row.id.pgn == 127251) {
      ASSERT_TRUE(decodeN2kPayload(row.id.pgn, row.bytes, message));
      EXPECT_FALSE(message.number("sid"));
      EXPECT_NEAR(*message.number("rate_of_turn_radps") / kRadiansPerDegree, -0.029649, 0.5e-6);
    }
    if (row.id.pgn == 126992) {
      ASSERT_TRUE(decodeN2kPayload(row.id.pgn, row.bytes, message));
      EXPECT_DOUBLE_EQ(*message.number("time_of_day_s"), 10 * 3600 + 16 * 60 + 50.0001);
    }
  }
}

TEST(CanCapture, CanboatsOwnFormIsReadFramesAndWholeMessages) {
  FATHOM_REQUIRE_DATA("can/pgn-test.in");
  FATHOM_REQUIRE_DATA("can/recombine-frames.in");
  const auto only = [](const std::vector<json>& messages, int pgn) {
    std::vector<json> out;
    for (const json& message : messages)
      if (message["pgn"] == pgn) out.push_back(message);
    return out;
  };
  const std::vector<json> fixes = only(runJson(test::dataFile("can/pgn-test.in")), 129029);
  ASSERT_EQ(fixes.size(), 1U);
  EXPECT_NEAR(fixes[0]["fields"]["latitude_deg"].get<double>(), 52.7461333, 0.5e-7);
  EXPECT_NEAR(fixes[0]["time_s"].get<double>(), 1303712703.603, 1e-6);  // 2011-04-25 06:25:03.603
  // Each file's frames are put together as those of candump are.
  const std::vector<json> frames = only(runJson(test::dataFile("can/recombine-frames.in")), 129029);
  ASSERT_FALSE(frames.empty());
  for (const json& fix : frames) EXPECT_NEAR(fix["fields"]["latitude_deg"].get<double>(), 42.4967684, 0.5e-7);
}

TEST(CanCapture, FastPacketsAreRecombinedAsCanboatRecombinesThem) {
  FATHOM_REQUIRE_DATA("can/recombine-frames.in");
  FATHOM_REQUIRE_DATA("can/recombine-frames.out");
  FastPacketAssembler assembler;
  std::vector<std::pair<std::uint32_t, std::vector<std::uint8_t>>> packets;
  for (const CanboatRow& row : readCanboatRows(test::dataFile("can/recombine-frames.in"))) {
    if (row.id.pgn == 130311) continue;  // a single frame
    CanFrame frame{.utc_ns = {}, .size = static_cast<std::uint8_t>(row.bytes.size())};
    std::copy(row.bytes.begin(), row.bytes.end(), frame.data.begin());
    const auto packet = assembler.add(row.id, frame);
    if (!packet.empty())
      packets.emplace_back(row.id.pgn, std::vector<std::uint8_t>(packet.begin(), packet.end()));
  }
  std::multiset<std::uint32_t> expected;
  std::ifstream in(test::dataFile("can/recombine-frames.out"));
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    std::string stamp;
    std::uint32_t priority = 0, source = 0, destination = 0, pgn = 0;
    if (words >> stamp >> priority >> source >> destination >> pgn && pgn != 130311) expected.insert(pgn);
  }
  // One packet of the file sends a frame ahead of its frame 0, which canboat takes. A CAN controller never
  // does that; taking it would mix frames of a packet that lost its frame 0 with the next.
  expected.erase(expected.find(129029));
  std::multiset<std::uint32_t> got;
  for (const auto& [pgn, bytes] : packets) {
    got.insert(pgn);
    if (pgn == 130823) {
      EXPECT_EQ(bytes.size(), 223U) << "32 frames, the most there can be";
    }
    if (pgn != 129029) continue;
    N2kMessage message;
    ASSERT_TRUE(decodeN2kPayload(pgn, bytes, message));
    EXPECT_NEAR(*message.number("latitude_deg"), 42.4967684, 0.5e-7);
    EXPECT_NEAR(*message.number("longitude_deg"), -71.5836637, 0.5e-7);
    EXPECT_NEAR(*message.number("altitude_m"), 90.984603, 1e-9);
    EXPECT_NEAR(*message.number("geoidal_separation_m"), -33.63, 1e-9);
  }
  EXPECT_EQ(got, expected);
}

TEST(CanCapture, TheFastPacketsOfTwoEnginesComeOutWhole) {
  FATHOM_REQUIRE_DATA("can/candump-fast.txt");
  const std::vector<std::uint8_t> text = test::readBytes(test::dataFile("can/candump-fast.txt"));
  CanTextReader reader;
  FastPacketAssembler assembler;
  std::vector<int> instances;
  const auto take = [&](const CanFrame& frame) {
    const auto packet = assembler.add(parseN2kId(frame.id), frame);
    if (packet.empty()) return;
    EXPECT_EQ(packet.size(), 26U);
    instances.push_back(packet[0]);
  };
  reader.feed(text, take);
  reader.drain(take);
  assembler.finish();
  EXPECT_EQ(reader.counts().frames, 23U);
  EXPECT_EQ(instances, (std::vector<int>{0, 1, 0, 1, 0}));
  EXPECT_EQ(assembler.counts().incomplete, 1U) << "the capture ends inside the sixth";
}

}  // namespace
}  // namespace fathom::io
