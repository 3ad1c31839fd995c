// How far features of rendered and real missions are from where they should be, and what they state: the
// table that simulated features are drawn from (sim/features), and what of it real images confirm.
#include <Eigen/Dense>
#include <cstdio>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/closure/frame_features.hpp"
#include "recon/topside/dive.hpp"
#include "sim/features/match_errors.hpp"
#include "tests/bench/common/measures.hpp"
#include "tests/bench/common/true_mission.hpp"
#include "tests/bench/reports.hpp"

namespace fathom::bench {
namespace {

namespace fs = std::filesystem;

// Bounds of distances between two features of a pair, over the image's width.
constexpr std::array<double, 5> kApart = {0.02, 0.05, 0.1, 0.2, 0.4};

// Least squares in a few unknowns.
struct Fit {
  Eigen::Matrix3d h = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  void add(const Eigen::Vector3d& row, double value) { h += row * row.transpose(), g += row * value; }
  void add(const Fit& more) { h += more.h, g += more.g; }
  [[nodiscard]] Eigen::Vector3d solved() const {
    return (h + 1e-9 * Eigen::Matrix3d::Identity()).ldlt().solve(g);
  }
};

// Of features of any number of missions. Ratios are over what the features state.
struct Errors {
  std::vector<double> place_ratio, match_ratio;
  std::vector<double> stated_place, stated_match, size;    // over the width; px; over the width
  std::array<double, kApart.size()> together{}, weight{};  // of place errors, by distance
  std::vector<double> place_px, match_px, across_px;
  // What a dive's features share: disparity by tangents [px], and the place's slope [tangent by tangent].
  Fit disparity, place_slope;

  void add(const Errors& more) {
    for (const auto values :
         {&Errors::place_ratio, &Errors::match_ratio, &Errors::stated_place, &Errors::stated_match,
          &Errors::size, &Errors::place_px, &Errors::match_px, &Errors::across_px})
      (this->*values).insert((this->*values).end(), (more.*values).begin(), (more.*values).end());
    for (std::size_t k = 0; k < kApart.size(); ++k)
      together[k] += more.together[k], weight[k] += more.weight[k];
    disparity.add(more.disparity);
    place_slope.add(more.place_slope);
  }
};

struct Stated {
  double place_px, match_px;
};

// Standard deviations across and along the ray, as pixels: the place's along the image's columns, and the
// disparity's.
Stated statedOf(const closure::Feature& f, const StereoRig& rig) {
  const Eigen::Vector3d p = f.point.cast<double>(), ray = p.normalized();
  const Eigen::Vector3d across = ray.cross(Eigen::Vector3d::UnitX()).normalized();
  const Eigen::Matrix3d c = f.covarianceMatrix();
  const double along_z = std::sqrt(ray.dot(c * ray)) * ray.z();
  return {std::sqrt(across.dot(c * across)) * rig.left.fy / p.norm(),
          along_z * rig.left.fx * rig.baseline() / (p.z() * p.z())};
}

// A mission's frames in order: features, and where their points truly are in the left camera's frame; of real
// missions as they were measured.
struct MeasuredFrame {
  closure::FrameFeatures features;
  std::vector<std::optional<Eigen::Vector3d>> points;
  SE3 T_nav_cam;
};

std::vector<MeasuredFrame> framesOf(const fs::path& folder, StereoRig& rig, bool& simulated) {
  topside::TopsideConfig config;
  const fs::path work = fs::temp_directory_path() / ("fathom-match-errors-" + std::to_string(::getpid()));
  std::vector<MeasuredFrame> frames;
  {
    topside::StageStore store(work, topside::StageStore::Access::kAlone);
    topside::RunProgress progress(topside::expectedShareUpTo(topside::Stage::kLocalise));
    topside::Dive dive(topside::openMission(folder, {}), config, store, progress, topside::Permission());
    const topside::SlamResult* slam = dive.localised();
    if (slam == nullptr)
      throw InputError(folder.string(), "", "its poses are given: there is nothing to measure");
    rig = dive.input().rig;
    simulated = fs::exists(folder / "truth" / "images.csv");
    std::optional<TrueMission> truth;
    std::map<std::string, std::size_t> listed;
    if (simulated) {
      truth.emplace(folder);
      rig = truth->rig();
      for (std::size_t k = 0; k < truth->pairs().size(); ++k) listed[truth->pairs()[k].left_name] = k;
    }
    const auto& pairs = dive.survey().list.pairs;
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      if (!slam->poses[k].T_nav_body || dive.prepared().count(k) == 0) continue;
      MeasuredFrame frame;
      dive.prepared().load(k, frame.features);
      frame.T_nav_cam = *slam->poses[k].T_nav_body * dive.input().mission.T_body_cam;
      std::optional<std::size_t> true_pair;
      if (truth) {
        const auto at = listed.find(fs::path(pairs[k].left).filename().string());
        if (at == listed.end()) continue;
        true_pair = at->second;
        frame.T_nav_cam = truth->pairs()[*true_pair].T_nav_cam;
      }
      for (const closure::Feature& f : frame.features.features)
        frame.points.push_back(true_pair ? truth->pointAt(*true_pair, f.left.cast<double>())
                                         : std::optional(Eigen::Vector3d(f.point.cast<double>())));
      frames.push_back(std::move(frame));
    }
  }
  fs::remove_all(work);
  return frames;
}

void addMatches(const MeasuredFrame& frame, const StereoRig& rig, bool simulated, Errors& out) {
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    if (!frame.points[i]) continue;
    const closure::Feature& f = frame.features.features[i];
    const Stated stated = statedOf(f, rig);
    const Eigen::Vector2d off = f.right.cast<double>() -
                                rig.right.project(rig.T_right_left * *frame.points[i]) -
                                (f.left.cast<double>() - rig.left.project(*frame.points[i]));
    out.stated_place.push_back(stated.place_px / rig.left.width);
    out.stated_match.push_back(stated.match_px);
    out.size.push_back(static_cast<double>(f.size) / rig.left.width);
    out.across_px.push_back(std::abs(off.y()));
    if (!simulated) continue;
    out.match_ratio.push_back(std::abs(off.x()) / stated.match_px);
    out.match_px.push_back(std::abs(off.x()));
    const Eigen::Vector3d& p = *frame.points[i];
    constexpr double kGross = 1;  // [px]
    if (std::abs(off.x()) < kGross) out.disparity.add({1, p.x() / p.z(), p.y() / p.z()}, -off.x());
  }
}

// Matches of two frames by their looks, no more than kFarthest from where poses say.
void addPlaces(const MeasuredFrame& a, const MeasuredFrame& b, const StereoRig& rig, Errors& out) {
  constexpr double kFarthest = 0.02, kBothViews = M_SQRT2;  // of the width
  constexpr double kClip = 3;                               // errors that count for neighbours, at most
  Eigen::MatrixXf distances;
  closure::Matches matches;
  closure::descriptorDistances(a.features, b.features, distances);
  closure::matchDescriptors(a.features, b.features, distances, nullptr, {}, matches);
  const SE3 T_b_a = b.T_nav_cam.inverse() * a.T_nav_cam;
  std::vector<std::pair<Eigen::Vector2d, Eigen::Vector2d>> errors;  // where, ratio
  for (const closure::Match& m : matches.best) {
    const auto i = static_cast<std::size_t>(m.a), j = static_cast<std::size_t>(m.b);
    if (!a.points[i]) continue;
    const Eigen::Vector3d p = T_b_a * *a.points[i];
    if (!(p.z() > 0.1)) continue;
    const Eigen::Vector2d found = b.features.features[j].left.cast<double>();
    const Eigen::Vector2d off = found - rig.left.project(p);
    if (off.norm() > kFarthest * rig.left.width) continue;
    const double stated = std::hypot(statedOf(a.features.features[i], rig).place_px,
                                     statedOf(b.features.features[j], rig).place_px);
    errors.emplace_back(found, off / stated);
    out.place_ratio.push_back(off.norm() / stated);
    out.place_px.push_back(off.norm() / kBothViews);
    const Eigen::Vector2d moved = p.head<2>() / p.z() - a.points[i]->head<2>() / a.points[i]->z();
    constexpr double kGross = 3;
    if (off.norm() < kGross * stated)
      for (int axis = 0; axis < 2; ++axis)
        out.place_slope.add({moved[axis], 0, 0}, off[axis] / (axis == 0 ? rig.left.fx : rig.left.fy));
  }
  for (std::size_t i = 0; i < errors.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) {
      const double apart = (errors[i].first - errors[j].first).norm() / rig.left.width;
      const auto bin =
          static_cast<std::size_t>(std::upper_bound(kApart.begin(), kApart.end(), apart) - kApart.begin());
      if (bin == kApart.size()) continue;
      const auto clipped = [&](const Eigen::Vector2d& e) -> Eigen::Vector2d {
        return e.cwiseMax(-kClip).cwiseMin(kClip);
      };
      const Eigen::Vector2d x = clipped(errors[i].second), y = clipped(errors[j].second);
      out.together[bin] += x.dot(y);
      out.weight[bin] += (x.squaredNorm() + y.squaredNorm()) / 2;
    }
}

// A row for each share of features: what so many are below.
constexpr double kShares[] = {0,    0.05,  0.1,  0.15,  0.2,   0.25,  0.3,    0.4,    0.5,
                              0.6,  0.7,   0.75, 0.8,   0.85,  0.9,   0.93,   0.95,   0.97,
                              0.98, 0.985, 0.99, 0.995, 0.998, 0.999, 0.9995, 0.9999, 1};

std::string tableOf(const Errors& e) {
  std::string out = std::string(sim::MatchErrors::kHeader) + "\n";
  for (const double share : kShares)
    out += formatted("%g,%.4g,%.4g,%.4g,%.4g,%.4g\n", share, quantile(e.place_ratio, share),
                     quantile(e.match_ratio, share), quantile(e.stated_match, share), quantile(e.size, share),
                     quantile(e.stated_place, share));
  return out;
}

struct MatchErrorOptions {
  std::vector<fs::path> missions;
  fs::path out;
};

void print(const std::string& name, const Errors& e) {
  const auto three = [](const std::vector<double>& values) {
    return formatted("%.3f %.3f %.2f", quantile(values, 0.5), quantile(values, 0.95), quantile(values, 0.99));
  };
  std::printf("%s: %zu matches; 50, 95, 99 %% of errors\n", name.c_str(), e.place_px.size());
  std::printf("  place px %s, over stated %s\n", three(e.place_px).c_str(), three(e.place_ratio).c_str());
  std::printf("  disparity px %s, over stated %s; across px %s\n", three(e.match_px).c_str(),
              three(e.match_ratio).c_str(), three(e.across_px).c_str());
  std::printf("  correlation of place by distance");
  for (std::size_t k = 0; k < kApart.size(); ++k)
    std::printf(" <%g: %.2f", kApart[k], e.weight[k] > 0 ? e.together[k] / e.weight[k] : 0);
  const Eigen::Vector3d disparity = e.disparity.solved();
  std::printf("\n  shared: disparity %.3f px, slopes %.3f %.3f px; place's slope %.5f\n", disparity[0],
              disparity[1], disparity[2], e.place_slope.solved()[0]);
}

int runMatchErrors(const MatchErrorOptions& options) {
  Errors all;
  for (const fs::path& folder : options.missions) {
    StereoRig rig;
    bool simulated = false;
    const std::vector<MeasuredFrame> frames = framesOf(folder, rig, simulated);
    Errors own;
    for (std::size_t k = 0; k < frames.size(); ++k) {
      addMatches(frames[k], rig, simulated, own);
      if (k > 0) addPlaces(frames[k - 1], frames[k], rig, own);
    }
    if (simulated) all.add(own);
    print(folder.filename().string(), own);
  }
  print("all simulated", all);
  if (!options.out.empty()) {
    AtomicFile file(options.out);
    file.stream() << tableOf(all);
    file.commit();
  }
  return kExitSuccess;
}

}  // namespace

void matchErrorReport(CommandLine& program) {
  static MatchErrorOptions o;
  CommandLine& command = program.command("match-errors", "Errors of features, and what they state", "",
                                         [] { return runMatchErrors(o); });
  command.add_option("missions", o.missions, "folders: simulated with truth, or anybody's images")
      ->required();
  command.add_option("--out", o.out, "file that gets the table of the simulated ones, for sim/features");
}

}  // namespace fathom::bench
