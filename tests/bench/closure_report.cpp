// Registration of pairs of frames against the truth of simulated missions: recall by overlap, false
// acceptances, errors, honesty of the covariance and time by stage, for each kind of descriptor. Writes a
// table and closures.json.
#include <time.h>

#include <CLI/CLI.hpp>
#include <Eigen/Dense>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <random>

#include "realtime/kernel/command_line.hpp"
#include "recon/closure/feature_extractor.hpp"
#include "recon/closure/feature_slot.hpp"
#include "recon/closure/given_features.hpp"
#include "recon/closure/registration.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "tests/bench/stereo_truth.hpp"

namespace fathom::closure {
namespace {

using Json = nlohmann::ordered_json;
using Stages = std::map<std::string, double>;

struct Kind {
  DescriptorKind kind;
  const char* name;
};
constexpr Kind kKinds[] = {{DescriptorKind::kRootSift, "sift"},
                           {DescriptorKind::kOrb, "orb"},
                           {DescriptorKind::kAkaze, "akaze"},
                           {DescriptorKind::kBrisk, "brisk"}};

enum Class : std::size_t { kConsecutive, kWide, kSome, kSliver, kNear, kFar, kClasses };
constexpr const char* kClassNames[kClasses] = {"consecutive", "over 30 %", "10-30 %",
                                               "0-10 %",      "0, near",   "0, far"};

double threadMs() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

// Adds the time since the last stage to the stage that ended.
class StageClock {
 public:
  void start() { last_ = threadMs(); }
  void ended(const char* stage) {
    const double now = threadMs();
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

ImageView viewOf(const cv::Mat& image) {
  return {image.data, image.cols, image.rows, image.step, PixelFormat::kMono, 8};
}

struct FramePair {
  std::size_t a = 0, b = 0;
  Class overlap = kFar;
};

// Truth of one frame: pose, and what a lattice of its left pixels sees.
struct TrueFrame {
  SE3 T_nav_cam;
  std::vector<Eigen::Vector3d> seen;  // left camera frame [m]
};

// Share of a's lattice that lies in b's left image.
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
  std::vector<stereo::TruePair> images;
};

Frames load(const stereo::TrueMission& mission, std::size_t every) {
  constexpr int kLattice = 10;
  Frames frames;
  const auto take = [&](std::size_t i) {
    const stereo::TruePair pair = mission.pair(i);
    TrueFrame truth{pair.T_nav_cam, {}};
    for (int y = 0; y < kLattice; ++y)
      for (int x = 0; x < kLattice; ++x)
        if (const auto p = mission.pointAt(pair, {(x + 0.5) * mission.rig().left.width / kLattice,
                                                  (y + 0.5) * mission.rig().left.height / kLattice}))
          truth.seen.push_back(*p);
    frames.index.push_back(i);
    frames.truth.push_back(std::move(truth));
    frames.images.push_back(pair);
  };
  // Every so many, and the next one, for the consecutive pairs.
  for (std::size_t i = 0; i + 1 < mission.pairs(); i += every) {
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

// What navigation would know: the truth with errors of these standard deviations, in frame b's camera. For
// frames that share nothing it claims the worst: that one lies over the other.
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

double meanOf(const std::vector<double>& v) {
  double sum = 0;
  for (const double x : v) sum += x;
  return v.empty() ? 0 : sum / static_cast<double>(v.size());
}
double quantile(std::vector<double> v, double q) {
  if (v.empty()) return 0;
  std::sort(v.begin(), v.end());
  return v[static_cast<std::size_t>(q * static_cast<double>(v.size() - 1))];
}
double rmsOf(const std::vector<double>& v) {
  double sum = 0;
  for (const double x : v) sum += x * x;
  return v.empty() ? 0 : std::sqrt(sum / static_cast<double>(v.size()));
}

Json jsonOf(const Stages& stages) {
  Json json;
  for (const auto& [name, ms] : stages) json[name] = ms;
  return json;
}

struct Extracted {
  std::vector<FrameFeatures> frames;
  double mean_features = 0;
  Stages ms;  // a frame
};

Extracted extract(const stereo::TrueMission& mission, const Frames& frames, const FeatureConfig& config) {
  constexpr double kDepths[2] = {0.4, 2.0};  // by the altitude
  FeatureExtractor extractor(mission.rig(), config);
  StageClock clock;
  extractor.setStageObserver([&](const char* stage) { clock.ended(stage); });
  Extracted result;
  const auto count = static_cast<double>(frames.images.size());
  for (const stereo::TruePair& images : frames.images) {
    const double d = images.plane.distance;
    const DepthRange depths{kDepths[0] * d, kDepths[1] * d};
    clock.start();
    result.frames.push_back(mission.featuresOnly()
                                ? featuresFrom(images.features, mission.rig(), {config.max_features, depths})
                                : extractor.process(viewOf(images.left), viewOf(images.right), depths));
    result.mean_features += static_cast<double>(result.frames.back().size()) / count;
  }
  result.ms = clock.means(count);
  return result;
}

// `verbose`: one line a pair.
Json report(const stereo::TrueMission& mission, const Frames& frames, const std::vector<FramePair>& pairs,
            const Extracted& extracted, const FeatureConfig& features, const char* name, bool with_prior,
            bool verbose) {
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
  Json json{{"descriptor", name},
            {"width", features.max_width},
            {"prior", with_prior},
            {"features_per_frame", extracted.mean_features},
            {"slot_bytes", slotBytes(features.kind, static_cast<std::size_t>(features.max_features))},
            {"extraction_ms", jsonOf(extracted.ms)},
            {"registration_ms", jsonOf(matching.means(static_cast<double>(pairs.size())))}};
  std::printf("\n%s, %s prior: %.0f features a frame; ms a frame %s; ms a pair %s\n", name,
              with_prior ? "with" : "without", extracted.mean_features, json["extraction_ms"].dump().c_str(),
              json["registration_ms"].dump().c_str());
  std::printf("%-12s %5s %8s %5s %7s %7s | %7s %7s %7s | %7s %7s | %5s\n", "class", "pairs", "accepted",
              "false", "matches", "inliers", "mm rms", "mm p50", "mm p95", "deg rms", "deg p95", "NEES");
  for (std::size_t k = 0; k < kClasses; ++k) {
    const ClassResult& c = results[k];
    constexpr double kDegrees = 57.29577951308232;
    std::printf("%-12s %5d %8d %5d %7.0f %7.0f | %7.2f %7.2f %7.2f | %7.3f %7.3f | %5.2f ", kClassNames[k],
                c.pairs, c.accepted, c.wrong, meanOf(c.matches), meanOf(c.inliers), 1e3 * rmsOf(c.position),
                1e3 * quantile(c.position, 0.5), 1e3 * quantile(c.position, 0.95), kDegrees * rmsOf(c.angle),
                kDegrees * quantile(c.angle, 0.95), meanOf(c.nees));
    Json refusals;
    for (const auto& [reason, count] : c.refusals) {
      std::printf(" %s %d", reason.c_str(), count);
      refusals[reason] = count;
    }
    std::printf("\n");
    json["classes"].push_back({{"class", kClassNames[k]},
                               {"pairs", c.pairs},
                               {"accepted", c.accepted},
                               {"false", c.wrong},
                               {"mean_matches", meanOf(c.matches)},
                               {"mean_inliers", meanOf(c.inliers)},
                               {"position_rms_m", rmsOf(c.position)},
                               {"position_p95_m", quantile(c.position, 0.95)},
                               {"angle_rms_rad", rmsOf(c.angle)},
                               {"angle_p95_rad", quantile(c.angle, 0.95)},
                               {"nees_mean", meanOf(c.nees)},
                               {"refusals", refusals}});
  }
  return json;
}

int run(int argc, char** argv) {
  CLI::App app{"Loop closures against the truth of simulated missions"};
  std::vector<std::filesystem::path> missions;
  std::filesystem::path out = "closures.json";
  std::size_t every = 4, of_each = 50;
  FeatureConfig features;
  bool verbose = false;
  std::vector<std::string> names;
  app.add_option("mission", missions, "mission folders with full truth")->required();
  app.add_option("--out", out, "report to write");
  app.add_option("--every", every, "take every so many-th pair of images")->check(CLI::Range(2, 1000));
  app.add_option("--pairs", of_each, "pairs of frames of each class");
  app.add_option("--features", features.max_features, "features of a frame")->check(CLI::Range(20, 5000));
  app.add_option("--width", features.max_width, "features are sought in images at most so wide [px]")
      ->check(CLI::Range(64, 8192));
  app.add_option("--descriptor", names, "sift, orb, akaze, brisk; default: all");
  app.add_flag("--verbose", verbose, "one line a pair");
  if (const auto code = parseCommandLine("report_closure", app, argc, argv)) return *code;
  cv::setNumThreads(1);
  Json json = Json::array();
  for (const auto& folder : missions) {
    const stereo::TrueMission mission(folder);
    const Frames frames = load(mission, every);
    const std::vector<FramePair> pairs = choosePairs(mission.rig(), frames, of_each);
    std::printf("%s: %zu frames, %zu pairs\n", folder.filename().string().c_str(), frames.index.size(),
                pairs.size());
    for (const Kind& kind : kKinds) {
      if (mission.featuresOnly() && kind.kind != DescriptorKind::kRootSift) continue;
      if (!names.empty() && std::find(names.begin(), names.end(), kind.name) == names.end()) continue;
      features.kind = kind.kind;
      const Extracted extracted = extract(mission, frames, features);
      for (const bool with_prior : {false, true}) {
        Json part = report(mission, frames, pairs, extracted, features, kind.name, with_prior, verbose);
        part["mission"] = folder.filename().string();
        json.push_back(std::move(part));
      }
    }
  }
  AtomicFile file(out);
  file.stream() << json.dump(2) << '\n';
  file.commit();
  return 0;
}

}  // namespace
}  // namespace fathom::closure

int main(int argc, char** argv) {
  return fathom::runTool("report_closure", [&] { return fathom::closure::run(argc, argv); });
}
