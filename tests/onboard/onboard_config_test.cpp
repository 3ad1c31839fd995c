#include "realtime/onboard/onboard_config.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "realtime/base/input_error.hpp"
#include "tests/support/key_tables.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::onboard {
namespace {

class OnboardConfigFile : public testing::Test {
 protected:
  OnboardConfig read(const std::string& text) {
    const std::filesystem::path path = folder_.path() / "onboard.toml";
    std::ofstream(path) << text;
    return readOnboardConfig(path);
  }
  test::TemporaryFolder folder_;
};

TEST_F(OnboardConfigFile, ReadsTheGatesOfDeadReckoning) {
  const nav::DeadReckoningConfig plain = read("").reckoning;
  EXPECT_EQ(plain.max_dvl_gap, 2);
  EXPECT_EQ(plain.max_speed, 3);
  EXPECT_EQ(plain.max_turn_rate, 1);
  const OnboardConfig set =
      read("[nav]\nmax_dvl_gap_s = 4\nmax_speed_mps = 1.5\nmax_turn_rate_radps = 0.5\n");
  const nav::DeadReckoningConfig used = navCoreConfig(set, {}).odometry;
  EXPECT_EQ(used.max_dvl_gap, 4);
  EXPECT_EQ(used.max_speed, 1.5);
  EXPECT_EQ(used.max_turn_rate, 0.5);
}

TEST_F(OnboardConfigFile, DeadReckoningTakesTheTideThatTheMissionPredicts) {
  io::MissionConfig mission;
  EXPECT_FALSE(navCoreConfig({}, mission).odometry.tide);
  mission.start_utc_ns = 1'700'000'000'000'000'000;
  mission.tide_model = "sinusoid amplitude_m=1.5 period_s=1200 phase_rad=0";
  const auto tide = navCoreConfig({}, mission).odometry.tide;
  ASSERT_TRUE(tide);
  EXPECT_NEAR(tide->heightAt(mission.start_utc_ns + 300'000'000'000), 1.5, 1e-9);
  mission.tide_model = "harmonic";
  EXPECT_THROW((void)navCoreConfig({}, mission), InputError);
}

TEST_F(OnboardConfigFile, AProfileGivesWhatTheFileDoesNotSetItself) {
  const OnboardConfig usual = read(""), small = read("[computer]\nprofile = \"small\"\n"),
                      mixed = read("[stereo]\nmax_features = 900\n[computer]\nprofile = \"small\"\n"),
                      large = read("[computer]\nprofile = \"large\"\n");
  EXPECT_EQ(read("[computer]\nprofile = \"usual\"\n").stereo.max_features, usual.stereo.max_features);
  EXPECT_LT(small.stereo.max_features, usual.stereo.max_features);
  EXPECT_LT(small.live.memory.budget_bytes, usual.live.memory.budget_bytes);
  EXPECT_GT(large.stereo.max_features, usual.stereo.max_features);
  EXPECT_GT(large.map.max_level, usual.map.max_level);
  EXPECT_EQ(mixed.stereo.max_features, 900);
  EXPECT_EQ(mixed.localisation.features, small.localisation.features);
  const OnboardConfig again = read(onboardToml(mixed, {}));
  EXPECT_EQ(again.profile, Profile::kSmall);
  EXPECT_EQ(again.stereo.max_features, 900);
  EXPECT_EQ(again.localisation.features, small.localisation.features);
  EXPECT_THROW((void)read("[computer]\nprofile = \"tiny\"\n"), InputError);
}

TEST_F(OnboardConfigFile, WhatIsPrintedReadsAsTheSame) {
  const io::MissionConfig mission;
  const std::string printed = onboardToml(
      read("[link]\nmax_error_m = 0.1\n[can]\nheading_address = 7\ndepth_source = \"offset\"\n[realtime]\n"
           "hard_cpus = [1, 3]\nend_within_s = 60\n[lcm]\naccept = \"dvl gyro\"\n[dvl]\ndevice = "
           "\"udp:0.0.0.0:6000\"\n"
           "[sensors]\nheading_deg = 1\n[memory]\nvehicle_heap_mib = 32\n"),
      mission);
  for (const char* line :
       {"\n[link]  # what is sent to the ship\n", "\nmax_error_m = 0.1  # [m] 0.005 to 1.0, default 0.05: ",
        "\nupdate_error_m = 0.15  # [m] 0.1 to 10.0, default 0.075: ",
        "\nheading_address = 7  # -1 to 251, default -1: ",
        "\ndepth_source = \"offset\"  # pressure or depth or offset, default \"pressure\": ",
        "\nhard_cpus = [1, 3]  # array of 0 to 1023, default []: ",
        "\naccept = \"dvl gyro\"  # text, default \"\": ",
        "\nheading_deg = 1.0  # [deg] 0.001 to 20.0, default 0.343774677078: ",
        "\nvehicle_heap_mib = 32  # [MiB] "})
    EXPECT_NE(printed.find(line), std::string::npos) << line;
  EXPECT_EQ(onboardToml(read(printed), mission), printed);
  EXPECT_EQ(onboardToml(read(""), mission), onboardToml(readOnboardConfig(std::nullopt), mission));
}

TEST_F(OnboardConfigFile, ThePagesHaveItsKeys) {
  OnboardConfig defaults = readOnboardConfig(std::nullopt);
  ConfigListing listing;
  visitOnboard(listing, defaults, {});
  for (const char* folder : {"/firmware_if", "/realtime", "/recon"})
    test::expectPagesHoldKeys(std::string(FATHOM_SOURCE_DIR) + folder, "onboard", listing);
}

TEST_F(OnboardConfigFile, RefusesWhatNoVehicleDoes) {
  for (const char* line : {"max_dvl_gap_s = 0", "max_dvl_gap_s = 61", "max_speed_mps = 0",
                           "max_speed_mps = 21", "max_turn_rate_radps = 0", "max_turn_rate_radps = 11"})
    EXPECT_THROW((void)read("[nav]\n" + std::string(line) + "\n"), InputError) << line;
}

TEST_F(OnboardConfigFile, ReadsTheLimitsOfTheGraph) {
  const slam::NavigationConfig plain = read("").localisation.graph;
  EXPECT_EQ(plain.known_scale, 4);
  EXPECT_EQ(plain.turned_sigmas, 4);
  const OnboardConfig set = read("[slam]\nknown_scale = 9\nturned_sigmas = 2.5\n");
  EXPECT_EQ(set.localisation.graph.known_scale, 9);
  EXPECT_EQ(set.localisation.graph.turned_sigmas, 2.5);
  for (const char* line :
       {"known_scale = 0.5", "known_scale = 101", "turned_sigmas = 0", "turned_sigmas = 101"})
    EXPECT_THROW((void)read("[slam]\n" + std::string(line) + "\n"), InputError) << line;
}

// The file, the graph on board and the first fix take the same prior.
TEST_F(OnboardConfigFile, TakesTheErrorsOfTheNavigationSensors) {
  const slam::SensorNoise plain = read("").localisation.graph.noise;
  const OnboardConfig set = read("[sensors]\nusbl_shift_m = 0.5\nusbl_turn_deg = 0.2\ndvl_scale = 0.01\n");
  const slam::SensorNoise used = mapCoreConfig(set, {}, {}).localisation.graph.noise;
  EXPECT_EQ(used.usbl_shift, 0.5);
  EXPECT_NEAR(used.usbl_turn, 0.2 * 0.01745329, 1e-8);
  EXPECT_EQ(used.dvl_scale, 0.01);
  EXPECT_EQ(used.visual_scale, plain.visual_scale);
  EXPECT_THROW((void)read("[sensors]\nusbl_shift_m = -1\n"), InputError);
  EXPECT_THROW((void)read("[sensors]\nusbl_shift = 1\n"), InputError);
}

TEST_F(OnboardConfigFile, SaysWhatTheModemTakesAtOnce) {
  const telemetry::LinkSchedulerConfig plain = read("").link.scheduler;
  EXPECT_EQ(plain.modem_bytes, 0);
  EXPECT_FALSE(plain.padded);
  EXPECT_EQ(plain.preamble_s, 0);
  const telemetry::LinkSchedulerConfig set =
      read("[link]\nframe_bytes = 64\nmodem_bytes = 512\npadded = true\npreamble_s = 1.5\n").link.scheduler;
  EXPECT_EQ(set.modem_bytes, 512);
  EXPECT_TRUE(set.padded);
  EXPECT_EQ(set.preamble_s, 1.5);
  for (const char* line : {"modem_bytes = 63", "modem_bytes = 129", "modem_bytes = 2049", "padded = true",
                           "preamble_s = -0.1", "preamble_s = 5.1"})
    EXPECT_THROW((void)read("[link]\n" + std::string(line) + "\n"), InputError) << line;
}

}  // namespace
}  // namespace fathom::onboard
