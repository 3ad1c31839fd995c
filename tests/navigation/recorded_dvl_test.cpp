// Dead reckoning of recorded dives, where their data are at hand (FATHOM_DATA_DIR).
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/navigation/dead_reckoning/dead_reckoning.hpp"
#include "recon/navigation/sensors/sensor_factors.hpp"

namespace fathom::nav {
namespace {

std::filesystem::path recorded(const std::string& name) {
  return std::filesystem::path(FATHOM_DATA_DIR) / "real" / name;
}

// The columns of a CSV file by their headings; quotes hold no comma that matters here.
class Table {
 public:
  explicit Table(const std::filesystem::path& path) {
    std::ifstream in(path);
    std::string line, cell;
    std::getline(in, line);
    if (!line.empty() && line.back() == '\r') line.pop_back();
    std::istringstream headings(line);
    for (std::size_t k = 0; std::getline(headings, cell, ',');) column_[cell] = k++;
    while (std::getline(in, line)) {
      std::istringstream text(line);
      std::vector<std::string> row;
      while (std::getline(text, cell, ',')) row.push_back(cell);
      if (row.size() >= column_.size()) rows_.push_back(row);  // not the rest of a quoted line's end
    }
  }
  [[nodiscard]] std::size_t size() const { return rows_.size(); }
  [[nodiscard]] double number(std::size_t row, const std::string& heading) const {
    return std::stod(rows_[row][column_.at(heading)]);
  }

 private:
  std::map<std::string, std::size_t> column_;
  std::vector<std::vector<std::string>> rows_;
};

constexpr std::int64_t kRecordStart_ns = 1'700'000'000'000'000'000;  // [ns]
std::int64_t recordTime(double seconds) {
  return kRecordStart_ns + std::llround(seconds * 1e9);
}

// What dead reckoning errs by over 100 s, and what its step claims.
struct Drift {
  double error = 0, claimed = 0, path = 0;  // horizontal; of either component; straight [m]
};

constexpr double kSpan = 100;  // [s]

std::vector<Drift> driftsOf(const Table& dvl, const Table& truth) {
  const LocalTransverseMercator local(
      {truth.number(0, "Latitude [rad]"), truth.number(0, "Longitude [rad]")});
  DeadReckoning nav({});
  std::vector<std::pair<SE3, Eigen::Vector2d>> poses;  // reckoned, true
  const slam::SensorNoise noise;
  for (std::size_t k = 0; k < dvl.size(); ++k) {
    const double t = dvl.number(k, "Time [s]");
    nav.add(AttitudeSample{recordTime(t), truth.number(k, "Roll [rad]"), truth.number(k, "Pitch [rad]"),
                           truth.number(k, "Yaw [rad]"), false});
    nav.add(DepthSample{recordTime(t), -truth.number(k, "Altitude [m]")});
    DvlSample ensemble;
    ensemble.utc_ns = recordTime(t);
    ensemble.velocity = Eigen::Vector3d(dvl.number(k, "DVL X [m/s]"), dvl.number(k, "DVL Y [m/s]"),
                                        dvl.number(k, "DVL Z [m/s]"));
    nav.add(ensemble);
    const auto pose = nav.poseAt(recordTime(t));
    if (!pose) ADD_FAILURE() << "no pose at " << t << " s";
    poses.emplace_back(pose.value_or(SE3()), local.toLocal({truth.number(k, "Latitude [rad]"),
                                                            truth.number(k, "Longitude [rad]")}));
  }
  EXPECT_EQ(nav.counters().dvl_used, dvl.size());
  std::vector<Drift> drifts;
  const double interval = dvl.number(1, "Time [s]");
  const auto span = static_cast<std::size_t>(std::lround(kSpan / interval));
  for (std::size_t k = 0; k + span < poses.size(); k += span) {
    const auto& [reckoned_a, true_a] = poses[k];
    const auto& [reckoned_b, true_b] = poses[k + span];
    const Eigen::Vector3d moved = reckoned_b.translation() - reckoned_a.translation();
    const slam::StepQuality quality{interval * static_cast<double>(span), 0, 0,
                                    std::max(noise.dvl_scale, noise.dvl_heading), 0};
    // Second by second, as keyframes would have it.
    double wander = 0;
    for (std::size_t i = k; i < k + span; ++i) {
      const Eigen::Vector3d step = poses[i + 1].first.translation() - poses[i].first.translation();
      wander = std::hypot(wander, slam::wanderSigma(step.norm(), interval, noise));
    }
    drifts.push_back({(moved.head<2>() - (true_b - true_a)).norm(),
                      std::hypot(slam::stepSigma(moved.norm(), quality, noise), wander), moved.norm()});
  }
  return drifts;
}

TEST(RecordedDvl, DriftOverAHundredSecondsAgainstANavigationGradeReference) {
  if (!std::filesystem::exists(recorded("snapir"))) GTEST_SKIP() << recorded("snapir") << " is not there";
  std::printf("dive  path m  error m: median  worst   claimed sigma m   NEES (2 expected)\n");
  std::vector<double> errors;
  double nees = 0;
  for (int dive = 1; dive <= 8; ++dive) {
    const std::string name = "trajectory" + std::to_string(dive) + ".csv";
    const std::vector<Drift> drifts =
        driftsOf(Table(recorded("snapir/DVL_" + name)), Table(recorded("snapir/GT_" + name)));
    ASSERT_EQ(drifts.size(), 3U);
    std::vector<double> here, claimed, path;
    double sum = 0;
    for (const Drift& d : drifts) {
      here.push_back(d.error);
      claimed.push_back(d.claimed);
      path.push_back(d.path);
      sum += d.error * d.error / (d.claimed * d.claimed);
    }
    std::printf("%4d %7.0f %16.2f %6.2f %17.2f %19.1f\n", dive, median(path), median(here),
                *std::max_element(here.begin(), here.end()), median(claimed), sum / 3);
    errors.insert(errors.end(), here.begin(), here.end());
    nees += sum / 24;
  }
  std::printf(" all         %16.2f %6.2f %37.1f\n", median(errors),
              *std::max_element(errors.begin(), errors.end()), nees);
  EXPECT_LT(median(errors), 6);
  EXPECT_LT(*std::max_element(errors.begin(), errors.end()), 10);
  // 2 expected; standard deviations within 1.3 of what is seen.
  EXPECT_GT(nees, 2 / (1.3 * 1.3));
  EXPECT_LT(nees, 2 * 1.3 * 1.3);
}

TEST(RecordedDvl, BeamsLostAndFoundInACaveNeitherLeapNorThrow) {
  if (!std::filesystem::exists(recorded("caves_linkquest")))
    GTEST_SKIP() << recorded("caves_linkquest") << " is not there";
  const Table dvl(recorded("caves_linkquest/dvl_linkquest.csv"));
  const Table depth(recorded("caves_linkquest/depth_sensor.csv"));
  const auto stamp = [](const Table& table, std::size_t row) {
    return std::llround(table.number(row, "header.stamp.secs")) * 1'000'000'000 +
           std::llround(table.number(row, "header.stamp.nsecs"));
  };
  constexpr std::int64_t kSilent = 600'000'000'000, kSilence = 30'000'000'000;  // the cable is out [ns]
  const std::int64_t begin = stamp(dvl, 0);
  DeadReckoning nav({});
  std::uint64_t ensembles = 0, absent = 0, beams_lost = 0;
  std::int64_t last = begin;
  std::size_t next_depth = 0;
  double longest = 0, fastest = 0;
  std::optional<SE3> before;
  for (std::size_t k = 0; k < dvl.size(); ++k) {
    const std::int64_t t = stamp(dvl, k);
    // The recording has no attitude: level, northward, at 10 Hz.
    for (; next_depth < depth.size() && stamp(depth, next_depth) <= t; ++next_depth) {
      nav.add(AttitudeSample{stamp(depth, next_depth), 0, 0, 0, false});
      nav.add(DepthSample{stamp(depth, next_depth), depth.number(next_depth, "depth")});
    }
    if (t - begin >= kSilent && t - begin < kSilent + kSilence) continue;
    DvlSample ensemble;
    ensemble.utc_ns = t;
    ensemble.sound_speed = dvl.number(k, "soundSpeed");
    for (std::size_t beam = 0; beam < 4; ++beam) {
      if (dvl.number(k, "dataGood_" + std::to_string(beam)) == 0) {
        ++beams_lost;
        continue;
      }
      ensemble.range[beam] = dvl.number(k, "altitudeBeam_" + std::to_string(beam));
    }
    if (const double altitude = dvl.number(k, "altitude"); altitude > 0) ensemble.altitude = altitude;
    if (dvl.number(k, "velocityInstFlag") == 1)
      ensemble.velocity = Eigen::Vector3d(dvl.number(k, "velocityInst_0"), dvl.number(k, "velocityInst_1"),
                                          dvl.number(k, "velocityInst_2"));
    absent += ensemble.velocity ? 0 : 1;
    if (ensemble.velocity) fastest = std::max(fastest, ensemble.velocity->norm());
    nav.add(ensemble);
    ++ensembles;
    for (; last < nav.newestUtcNs(); last += 10'000'000) {
      const auto pose = nav.poseAt(last);
      if (before && pose)
        longest = std::max(longest, (pose->translation() - before->translation()).head<2>().norm());
      before = pose;
    }
  }
  const DeadReckoning::Counters& c = nav.counters();
  std::printf(
      "%llu ensembles, %llu beams lost, %llu without bottom track, %llu used, %llu before the start, "
      "coasted %llu times for %.1f s, fastest %.2f m/s\n",
      static_cast<unsigned long long>(ensembles), static_cast<unsigned long long>(beams_lost),
      static_cast<unsigned long long>(c.dvl_without_bottom), static_cast<unsigned long long>(c.dvl_used),
      static_cast<unsigned long long>(c.dvl_before_start), static_cast<unsigned long long>(c.coasted),
      nav.qualityAt(nav.newestUtcNs()).unlocked_s, fastest);
  EXPECT_GT(ensembles, 5000U);
  EXPECT_EQ(c.dvl_without_bottom, absent);
  EXPECT_EQ(c.dvl_rejected + c.out_of_order + c.dvl_queue_full, 0U);
  EXPECT_GE(c.dvl_used + c.dvl_before_start + c.dvl_without_bottom + 5, ensembles);
  EXPECT_EQ(c.coasted, 1U);  // for the silence alone: lost beams are bridged
  EXPECT_NEAR(nav.qualityAt(nav.newestUtcNs()).unlocked_s, 30, 1);
  EXPECT_LT(longest, 1.01 * fastest * 0.01);  // in 10 ms: no leap
  EXPECT_GT(nav.newestUtcNs(), stamp(dvl, dvl.size() - 1) - 1'000'000'000);
}

}  // namespace
}  // namespace fathom::nav
