// The real captures against what independent decoders said of them.
#include <gtest/gtest.h>

#include <charconv>
#include <cmath>
#include <fstream>
#include <map>

#include "tests/support/program_run.hpp"

namespace fathom::io {
namespace {

test::Outcome run(const char* file, const std::string& arguments) {
  return test::runProgram("fathom-sensors dvl " + test::dataFile(file).string() + arguments);
}

std::vector<std::string> fields(const std::string& line) {
  std::vector<std::string> out(1);
  for (const char c : line) {
    if (c == ',') {
      out.emplace_back();
    } else {
      out.back().push_back(c);
    }
  }
  return out;
}

// The integers of an ensemble as the .yml files give them: raw values by name. Values that are only listed
// when they change (speed_of_sound) hold until the next.
using Record = std::map<std::string, long long>;

std::vector<Record> readYml(const std::filesystem::path& path) {
  std::vector<Record> ensembles;
  std::ifstream in(path);
  Record last;
  for (std::string line; std::getline(in, line);) {
    const std::size_t colon = line.find(':');
    if (line.rfind("    ", 0) != 0 || colon == std::string::npos) continue;
    const std::string name = line.substr(4, colon - 4);
    const std::string text = line.substr(std::min(colon + 2, line.size()));
    if (name == "internal_timestamp") {
      // Seconds since 1900 with the clock's resolution of 10 ms.
      const auto hundredths = std::llround(std::stold(text) * 100);
      if (ensembles.empty() || ensembles.back()["hundredths"] != hundredths) {
        ensembles.emplace_back();
        if (last.contains("speed_of_sound")) ensembles.back()["speed_of_sound"] = last["speed_of_sound"];
      }
      ensembles.back()["hundredths"] = hundredths;
      continue;
    }
    long long value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end == text.data() || ensembles.empty()) continue;
    ensembles.back()[name] = value;
    last = ensembles.back();
  }
  return ensembles;
}

// `scale` raw units are one unit of the CSV.
void expectField(const std::string& text, const Record& record, const std::string& name, long long scale,
                 long long absent) {
  ASSERT_TRUE(record.contains(name)) << name;
  const long long raw = record.at(name);
  if (raw == absent) {
    EXPECT_EQ(text, "") << name;
    return;
  }
  ASSERT_NE(text, "") << name;
  EXPECT_NEAR(std::stod(text) * static_cast<double>(scale), static_cast<double>(raw), 1e-6) << name;
}

class DvlYml : public testing::TestWithParam<std::pair<const char*, std::size_t>> {};

TEST_P(DvlYml, EveryFieldOfTheCsvAgreesWithTheYml) {
  const std::string name = GetParam().first;
  FATHOM_REQUIRE_DATA("dvl/" + name + ".pd0");
  FATHOM_REQUIRE_DATA("dvl/" + name + ".yml");
  const std::vector<Record> expected = readYml(test::dataFile("dvl/" + name + ".yml"));
  const auto lines = test::linesOf(run(("dvl/" + name + ".pd0").c_str(), " --csv").out);
  ASSERT_EQ(expected.size(), GetParam().second);
  ASSERT_EQ(lines.size(), expected.size() + 1);
  EXPECT_EQ(
      lines[0],
      "ensemble,utc_ns,frame,v1_mps,v2_mps,v3_mps,v4_mps,range1_m,range2_m,range3_m,range4_m,heading_deg,"
      "pitch_deg,roll_deg,sound_speed_mps");
  constexpr long long kNever = 1LL << 40;
  const std::array<const char*, 4> frames = {"beam", "instrument", "ship", "earth"};
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const Record& record = expected[i];
    const auto row = fields(lines[i + 1]);
    ASSERT_EQ(row.size(), 15U) << lines[i + 1];
    expectField(row[0], record, "ensemble_number", 1, kNever);
    constexpr long long kSecondsFrom1900To1970 = 2'208'988'800;
    EXPECT_EQ(std::stoll(row[1]), (record.at("hundredths") - kSecondsFrom1900To1970 * 100) * 10'000'000);
    EXPECT_EQ(row[2], frames[static_cast<std::size_t>(record.at("coord_transform_type"))]);
    const std::array<const char*, 4> velocity = {"bt_forward_velocity", "bt_starboard_velocity",
                                                 "bt_vertical_velocity", "bt_error_velocity"};
    for (std::size_t k = 0; k < 4; ++k) {
      expectField(row[3 + k], record, velocity[k], 1000, -32768);
      expectField(row[7 + k], record, "bt_beam" + std::to_string(k + 1) + "_range", 100, 0);
    }
    expectField(row[11], record, "heading", 100, kNever);
    expectField(row[12], record, "pitch", 100, kNever);
    expectField(row[13], record, "roll", 100, kNever);
    expectField(row[14], record, "speed_of_sound", 1, kNever);
  }
}

INSTANTIATE_TEST_SUITE_P(RealCaptures, DvlYml,
                         testing::Values(std::pair<const char*, std::size_t>{"adcp_auv_3", 3},
                                         std::pair<const char*, std::size_t>{"adcp_auv_51", 51}),
                         [](const auto& parameter) { return std::string(parameter.param.first); });

TEST(DvlCapture, TheLongDiveGives4132EnsemblesOfWhich3535HaveBottomTrack) {
  FATHOM_REQUIRE_DATA("dvl/adcp.adc");
  const test::Outcome output = run("dvl/adcp.adc", " --csv");
  const auto lines = test::linesOf(output.out);
  ASSERT_EQ(lines.size(), 4132U + 1U);
  int with_velocity = 0;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    const auto row = fields(lines[i]);
    ASSERT_EQ(row.size(), 15U);
    EXPECT_EQ(row[2], "ship");
    if (row[3] != "" && row[4] != "" && row[5] != "") ++with_velocity;
  }
  EXPECT_EQ(with_velocity, 3535);
  EXPECT_NE(output.err.find("good 4132, bad-checksum 0, resynced 0"), std::string::npos) << output.err;
}

TEST(DvlCapture, TheSummaryCountsEnsemblesAndBottomTrack) {
  FATHOM_REQUIRE_DATA("dvl/adcp.adc");
  const auto lines = test::linesOf(run("dvl/adcp.adc", "").out);
  ASSERT_GE(lines.size(), 2U);
  EXPECT_NE(lines[0].find("4132"), std::string::npos);
  EXPECT_NE(lines[1].find("3535"), std::string::npos);
}

TEST(DvlCapture, TheCorruptedFileLosesOnlyItsDamagedEnsemble) {
  FATHOM_REQUIRE_DATA("dvl/LB180210_3_corrupted.PD0");
  const test::Outcome output = run("dvl/LB180210_3_corrupted.PD0", " --csv");
  const auto lines = test::linesOf(output.out);
  ASSERT_EQ(lines.size(), 3U);
  EXPECT_EQ(fields(lines[1])[0], "1");
  EXPECT_EQ(fields(lines[2])[0], "3");
  EXPECT_NE(output.err.find("good 2, bad-checksum 1, resynced 1"), std::string::npos) << output.err;
  EXPECT_NE(output.err.find("skipped 446 bytes"), std::string::npos) << "the damaged ensemble's own size";
}

TEST(DvlCapture, ADiskThatIsFullIsFailedWork) {
  FATHOM_REQUIRE_DATA("dvl/adcp.adc");
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "this system has no /dev/full";
  EXPECT_EQ(run("dvl/adcp.adc", " --csv >/dev/full").exit_code, 1);
}

}  // namespace
}  // namespace fathom::io
