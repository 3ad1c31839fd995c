// Registration of pairs of frames against the truth of simulated missions: recall by overlap, false
// acceptances, errors, consistency of the covariance (NEES) and time by stage. Writes closure.html
// and closure.json.
#include <Eigen/Dense>
#include <cstdio>
#include <map>
#include <random>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/closure/feature_extractor.hpp"
#include "recon/closure/registration.hpp"
#include "tests/bench/common/measures.hpp"
#include "tests/bench/common/page.hpp"
#include "tests/bench/common/true_mission.hpp"
#include "tests/bench/reports.hpp"

namespace fathom::closure {
namespace {

using bench::cell, bench::cpuMs, bench::TrueMission;
using Stages = std::map<std::string, double>;

enum Class : std::size_t { kConsecutive, kWide, kSome, kSliver, kNear, kFar, kClasses };
constexpr const char* kClassNames[kClasses] = {"consecutive", "over 30 %", "10-30 %",
                                               "0-10 %",      "0, near",   "0, far"};

// Adds the time since the last stage to the stage that ended.
class StageClock {
 public:
  void start() { last_ = cpuMs(); }
  void ended(const char* stage) {
    const double now = cpuMs();
    sums_[stage] += now - last_;
    last_ = now;
  }
  [[nodiscard]] Stages means(double runs) const {
    Stages means;
    for (const auto& [name, ms] : sums_) means[name] = ms / std::max(runs, 1.0);
    return means;
  }

 private:
  Stages sums_;
  double last_ = 0;
};

struct FramePair {
  std::size_t a = 0, b = 0;
  Class overlap = kFar;
};

// Truth of one frame: pose, and the seafloor at a lattice of its left pixels.
struct TrueFrame {
  SE3 T_nav_cam;
  std::vector<Eigen::Vector3d> seen;  // left camera frame [m]
};

// Share of a's lattice within b's left image.
double overlapOf(const StereoRig& rig, const TrueFrame& a, const TrueFrame& b) {
  const SE3 T_b_a = b.T_nav_cam.inverse() * a.T_nav_cam;
  int inside = 0;
  for (const Eigen::Vector3d& p : a.seen) {
    const Eigen::Vector3d q = T_b_a * p;
    inside += q.z() > 0.1 && rig.left.contains(rig.left.project(q)) ? 1 : 0;
  }
  return static_cast<double>(inside) / static_cast<double>(std::max<std::size_t>(a.seen.size(), 1));
}

struct Frames {
  std::vector<std::size_t> index;  // in the mission
  std::vector<TrueFrame> truth;
};

Frames load(const TrueMission& mission, std::size_t every) {
  constexpr int kLattice = 10;
  Frames frames;
  const auto take = [&](std::size_t i) {
    TrueFrame truth{mission.pairs()[i].T_nav_cam, {}};
    for (int y = 0; y < kLattice; ++y)
      for (int x = 0; x < kLattice; ++x)
        if (const auto p = mission.pointAt(i, {(x + 0.5) * mission.rig().left.width / kLattice,
                                               (y + 0.5) * mission.rig().left.height / kLattice}))
          truth.seen.push_back(*p);
    frames.index.push_back(i);
    frames.truth.push_back(std::move(truth));
  };
  // Every so many, and the next one, for the consecutive pairs.
  for (std::size_t i = 0; i + 1 < mission.pairs().size(); i += every) {
    take(i);
    take(i + 1);
  }
  return frames;
}

std::vector<FramePair> choosePairs(const StereoRig& rig, const Frames& frames, std::size_t of_each) {
  constexpr double kNearby = 5;       // without overlap, but within dead reckoning's drift [m]
  constexpr std::size_t kApart = 20;  // frames: not seen one after the other
  std::vector<FramePair> all[kClasses];
  for (std::size_t j = 0; j < frames.index.size(); ++j) {
    for (std::size_t i = 0; i < j; ++i) {
      const std::size_t apart = frames.index[j] - frames.index[i];
      if (apart == 1) all[kConsecutive].push_back({i, j, kConsecutive});
      if (apart < kApart || j % 2 == 1 || i % 2 == 1) continue;
      const double share = std::min(overlapOf(rig, frames.truth[i], frames.truth[j]),
                                    overlapOf(rig, frames.truth[j], frames.truth[i]));
      const bool touches = share > 0 || overlapOf(rig, frames.truth[i], frames.truth[j]) > 0 ||
                           overlapOf(rig, frames.truth[j], frames.truth[i]) > 0;
      const double distance =
          (frames.truth[i].T_nav_cam.translation() - frames.truth[j].T_nav_cam.translation()).norm();
      const Class c = share > 0.3          ? kWide
                      : share > 0.1        ? kSome
                      : touches            ? kSliver
                      : distance < kNearby ? kNear
                                           : kFar;
      all[c].push_back({i, j, c});
    }
  }
  std::vector<FramePair> chosen;
  std::mt19937 random(7);
  for (auto& of_class : all) {
    for (std::size_t k = 0; k < of_class.size() && k < of_each; ++k) {
      std::swap(of_class[k], of_class[k + random() % (of_class.size() - k)]);
      chosen.push_back(of_class[k]);
    }
  }
  return chosen;
}

Vector6d differenceOf(const SE3& estimate, const SE3& truth) {
  const SE3 d = estimate.inverse() * truth;
  const Eigen::AngleAxisd turn(d.rotation());
  Vector6d v;
  v << d.translation(), wrapAngle(turn.angle()) * turn.axis();
  return v;
}

// The prior of navigation: the truth with errors of these standard deviations, in frame b's camera. For
// frames without overlap it is the worst case: that both are at one place.
RelativePrior priorOf(const SE3& truth, Class overlap, std::mt19937& random) {
  Vector6d sigma;
  if (overlap == kConsecutive)
    sigma << 0.03, 0.03, 0.02, 0.005, 0.005, 0.01;
  else
    sigma << 1.0, 1.0, 0.1, 0.01, 0.01, 0.05;
  std::normal_distribution<double> normal;
  Vector6d error;
  for (int k = 0; k < 6; ++k) error(k) = sigma(k) * normal(random);
  SE3 claimed = truth;
  if (overlap == kNear || overlap == kFar) {
    const Eigen::Vector3d& t = truth.translation();
    claimed = SE3(truth.rotation(), Eigen::Vector3d(0, 0, t.z()));
  }
  return {perturbed(claimed, error), Matrix6d(sigma.cwiseAbs2().asDiagonal())};
}

struct ClassResult {
  int pairs = 0, accepted = 0, wrong = 0;
  std::vector<double> position, angle, nees, inliers, matches;
  std::map<std::string, int> refusals;
};

std::string textOf(const Stages& stages) {
  std::string text;
  for (const auto& [name, ms] : stages) text += (text.empty() ? "" : ", ") + name + " " + decimals(ms, 2);
  return text;
}

struct Extracted {
  std::vector<FrameFeatures> frames;
  double mean_features = 0;
  Stages ms;  // a frame
};

Extracted extract(const TrueMission& mission, const Frames& frames, const FeatureConfig& config) {
  constexpr double kDepths[2] = {0.4, 2.0};  // by the altitude
  FeatureExtractor extractor(mission.rig(), config);
  StageClock clock;
  extractor.setStageObserver([&](const char* stage) { clock.ended(stage); });
  Extracted result;
  const auto count = static_cast<double>(frames.index.size());
  for (const std::size_t i : frames.index) {
    const double d = mission.pairs()[i].plane.distance;
    const DepthRange depths{kDepths[0] * d, kDepths[1] * d};
    if (mission.featuresOnly()) {
      result.frames.push_back(
          featuresFrom(mission.features(i), mission.rig(), {config.max_features, depths}));
    } else {
      const TrueMission::Images images = mission.corrected(i);
      clock.start();
      result.frames.push_back(
          extractor.process(bench::viewOf(images.left), bench::viewOf(images.right), depths));
    }
    result.mean_features += static_cast<double>(result.frames.back().size()) / count;
  }
  result.ms = clock.means(count);
  return result;
}

// `verbose`: one line a pair.
bench::Table reportOf(const TrueMission& mission, const Frames& frames, const std::vector<FramePair>& pairs,
                      const Extracted& extracted, const std::string& name, bool with_prior, bool verbose) {
  constexpr double kWrong[2] = {0.10, 0.05};  // an accepted pose that is off by more is false [m, rad]
  StageClock matching;
  Registrar registrar(mission.rig(), {});
  registrar.setStageObserver([&](const char* stage) { matching.ended(stage); });
  std::array<ClassResult, kClasses> results;
  std::mt19937 random(11);
  for (const FramePair& pair : pairs) {
    const SE3 truth = frames.truth[pair.a].T_nav_cam.inverse() * frames.truth[pair.b].T_nav_cam;
    std::optional<RelativePrior> prior;
    if (with_prior) prior = priorOf(truth, pair.overlap, random);
    matching.start();
    const Registration& r = registrar.process(extracted.frames[pair.a], extracted.frames[pair.b], prior);
    ClassResult& c = results[pair.overlap];
    ++c.pairs;
    c.matches.push_back(r.matches);
    const Vector6d e = differenceOf(r.T_a_b, truth);
    const double position = e.head<3>().norm(), angle = e.tail<3>().norm();
    if (verbose)
      std::printf(
          "%4zu %4zu %-11s %-13s matches %3d inliers %3zu of %3d share %.2f coverage %.2f "
          "distinct %3d %.2f significance %6.1f rival %.2f noise %.2f: %.4f m %.4f rad\n",
          frames.index[pair.a], frames.index[pair.b], kClassNames[pair.overlap],
          std::string(nameOf(r.refusal)).c_str(), r.matches, r.inliers.size(), r.overlap_features, r.share,
          r.coverage, r.distinct_inliers, r.distinct_coverage, r.significance, r.rival_share, r.noise,
          position, angle);
    if (!r.accepted()) {
      ++c.refusals[std::string(nameOf(r.refusal))];
      continue;
    }
    ++c.accepted;
    if (position > kWrong[0] || angle > kWrong[1]) {
      ++c.wrong;
      continue;
    }
    c.position.push_back(position);
    c.angle.push_back(angle);
    c.nees.push_back(e.dot(r.covariance.ldlt().solve(e)));
    c.inliers.push_back(static_cast<double>(r.inliers.size()));
  }
  const double count = static_cast<double>(pairs.size());
  bench::Table table{name + ", " + (with_prior ? "with" : "without") +
                         " prior: " + decimals(extracted.mean_features, 0) +
                         " features a frame; ms a frame: " + textOf(extracted.ms) +
                         "; ms a pair: " + textOf(matching.means(count)),
                     {{"class", 0},
                      {"pairs", 0},
                      {"accepted", 0},
                      {"false", 0},
                      {"matches", 0},
                      {"inliers", 0},
                      {"mm rms", 2},
                      {"mm p50", 2},
                      {"mm p95", 2},
                      {"deg rms", 3},
                      {"deg p95", 3},
                      {"NEES", 2},
                      {"refusals", 0}},
                     {}};
  for (std::size_t k = 0; k < kClasses; ++k) {
    const ClassResult& c = results[k];
    std::string refusals;
    for (const auto& [reason, times] : c.refusals) refusals += reason + " " + std::to_string(times) + " ";
    table.rows.push_back(
        {kClassNames[k], cell(c.pairs), cell(c.accepted), cell(c.wrong), bench::meanOf(c.matches),
         bench::meanOf(c.inliers), 1e3 * bench::rmsOf(c.position), 1e3 * bench::quantile(c.position, 0.5),
         1e3 * bench::quantile(c.position, 0.95), kDegreesPerRadian * bench::rmsOf(c.angle),
         kDegreesPerRadian * bench::quantile(c.angle, 0.95), bench::meanOf(c.nees), refusals});
  }
  return table;
}

struct ClosureOptions {
  std::vector<std::filesystem::path> missions;
  std::filesystem::path out;
  std::size_t every = 4, of_each = 50;
  FeatureConfig features;
  bool verbose = false;
};

int runClosure(const ClosureOptions& options) {
  cv::setNumThreads(1);
  bench::Page page("Loop closures against the truth");
  for (const auto& folder : options.missions) {
    const TrueMission mission(folder);
    const Frames frames = load(mission, options.every);
    const std::vector<FramePair> pairs = choosePairs(mission.rig(), frames, options.of_each);
    const Extracted extracted = extract(mission, frames, options.features);
    for (const bool with_prior : {false, true})
      page.add(reportOf(mission, frames, pairs, extracted, folder.filename().string(), with_prior,
                        options.verbose));
  }
  std::printf("%s", page.text().c_str());
  if (!options.out.empty()) page.write(options.out, "closure");
  return kExitSuccess;
}

}  // namespace
}  // namespace fathom::closure

namespace fathom::bench {

void closureReport(CommandLine& program) {
  static closure::ClosureOptions o;
  CommandLine& command = program.command("closure", "Loop closures against the truth of simulated missions",
                                         "", [] { return closure::runClosure(o); });
  command.add_option("missions", o.missions, "mission folders with full truth")->required();
  command.add_option("--out", o.out, "folder that gets closure.html and closure.json");
  command.shown("--every", o.every, "take every so many-th pair of images", 2, 1000);
  command.shown("--pairs", o.of_each, "pairs of frames of each class");
  command.shown("--features", o.features.max_features, "features of a frame", 20, 5000);
  command.shown("--width", o.features.max_width, "features are sought in images at most so wide [px]", 64,
                8192);
  command.add_flag("--verbose", o.verbose, "one line a pair");
}

}  // namespace fathom::bench
