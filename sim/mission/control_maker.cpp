#include "sim/mission/control_maker.hpp"

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "sim/scenario/random.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "sim/score/trajectory_score.hpp"
#include "sim/sea/sea_terrain.hpp"

namespace fathom::sim {
namespace {

constexpr int kLeastViews = 3;        // pairs that show a surveyed place
constexpr double kMarkMargin = 0.04;  // of the image's width along its borders, without marks

struct PairView {
  std::string left, right;
  SE3 T_nav_cam, T_cam_nav;
};

std::optional<Eigen::Vector2d> markablePixel(const Camera& camera, const Eigen::Vector3d& point) {
  if (!(point.z() > 0)) return {};
  const Eigen::Vector2d pixel = camera.project(point);
  const double margin = kMarkMargin * camera.width;
  const bool inside = pixel.x() > margin && pixel.y() > margin && pixel.x() < camera.width - margin &&
                      pixel.y() < camera.height - margin;
  return inside ? std::optional(pixel) : std::nullopt;
}

class VisibleSeabed {
 public:
  explicit VisibleSeabed(const std::filesystem::path& mission)
      : terrain_(loadScenario((io::MissionPaths(mission).truth() / "scenario.toml").string()).terrain) {
    const io::MissionPaths paths(mission);
    const TruthTrack truth(paths.truth());
    rig_ = readStereoCalib(io::MissionPaths(paths.truth()).calib());
    const SE3 T_body_cam = io::readMissionConfig(paths.truth()).T_body_cam;
    for (const TruthTrack::Pair& pair : truth.pairs())
      if (const auto pose = truth.poseAt(pair.utc_ns)) {
        const SE3 T_nav_cam = *pose * T_body_cam;
        views_.push_back({pair.left, pair.right, T_nav_cam, T_nav_cam.inverse()});
      }
    constexpr std::size_t kEnough = 20000;
    const std::vector<Eigen::Vector3f> vertices = terrain_.mesh().vertices;
    for (std::size_t k = 0; k < vertices.size(); k += vertices.size() / kEnough + 1) {
      const Eigen::Vector3d place = vertices[k].cast<double>();
      if (candidateViews(place).size() >= kLeastViews) places_.push_back(place);
    }
  }

  [[nodiscard]] const StereoRig& rig() const { return rig_; }
  [[nodiscard]] const std::vector<Eigen::Vector3d>& places() const { return places_; }
  // Pairs with a left image that shows a place, occlusion considered.
  [[nodiscard]] std::vector<const PairView*> viewsOf(const Eigen::Vector3d& place) const {
    constexpr double kHidden = 0.01;  // a place this far behind the first hit is hidden [m]
    std::vector<const PairView*> out;
    for (const PairView* view : candidateViews(place)) {
      const Eigen::Vector3d from = view->T_nav_cam.translation();
      const auto met = terrain_.castRay(from, place - from);
      if (!met || *met > (place - from).norm() - kHidden) out.push_back(view);
    }
    return out;
  }
  // Farthest-point sampling of `count` visible places; the first is random.
  [[nodiscard]] std::vector<Eigen::Vector3d> spread(int count, Random& random) const {
    std::vector<Eigen::Vector3d> out;
    std::vector<double> nearest(places_.size(), INFINITY);
    auto next = static_cast<std::size_t>(random.uniform() * static_cast<double>(places_.size()));
    while (static_cast<int>(out.size()) < count && nearest[next] > 0) {
      if (viewsOf(places_[next]).size() >= kLeastViews) {
        out.push_back(places_[next]);
        for (std::size_t i = 0; i < places_.size(); ++i)
          nearest[i] = std::min(nearest[i], (places_[i] - out.back()).norm());
      }
      nearest[next] = 0;
      next = static_cast<std::size_t>(std::max_element(nearest.begin(), nearest.end()) - nearest.begin());
    }
    return out;
  }

 private:
  // Pairs with the place inside the left image, occlusion not considered.
  [[nodiscard]] std::vector<const PairView*> candidateViews(const Eigen::Vector3d& place) const {
    std::vector<const PairView*> out;
    for (const PairView& view : views_)
      if (markablePixel(rig_.left, view.T_cam_nav * place)) out.push_back(&view);
    return out;
  }

  SeaTerrain terrain_;
  StereoRig rig_;
  std::vector<PairView> views_;
  std::vector<Eigen::Vector3d> places_;
};

}  // namespace

ControlMakerReport makeControl(const std::filesystem::path& mission, const ControlMakerOptions& options) {
  const VisibleSeabed seabed(mission);
  Random random(options.seed, "control");
  if (seabed.places().empty())
    throw InputError(mission.string(), "truth",
                     "no place of the seafloor is in " + std::to_string(kLeastViews) + " pairs");
  ControlMakerReport report;
  report.folder = options.out.empty() ? mission / "control" : options.out;
  std::filesystem::create_directories(report.folder);
  AtomicFile points(report.folder / "points.csv"), marks(report.folder / "marks.csv"),
      bars(report.folder / "scale_bars.csv");
  points.stream() << "name,north,east,depth,sigma_m,use\n";
  marks.stream() << "point,image,u,v,sigma_px\n";
  bars.stream() << "from,to,length_m,sigma_m\n";

  const auto mark = [&](const std::string& name, const Eigen::Vector3d& place) {
    const std::vector<const PairView*> views = seabed.viewsOf(place);
    const std::size_t count = std::min(views.size(), static_cast<std::size_t>(options.marks));
    for (std::size_t k = 0; k < count; ++k) {
      const PairView& view = *views[k * views.size() / count];
      const StereoRig& rig = seabed.rig();
      const Eigen::Vector3d point = view.T_cam_nav * place;
      // Every third mark is in the right image if that shows the place.
      const auto right = k % 3 == 2 ? markablePixel(rig.right, rig.T_right_left * point) : std::nullopt;
      const Eigen::Vector2d pixel = right ? *right : rig.left.project(point);
      marks.stream() << name << ',' << (right ? view.right : view.left) << ','
                     << formatted("%.2f,%.2f,%.2f\n", pixel.x() + random.gauss(options.pixel_sigma),
                                  pixel.y() + random.gauss(options.pixel_sigma), options.pixel_sigma);
      ++report.marks;
    }
  };
  const auto placed = seabed.spread(options.points + options.checks, random);
  for (const Eigen::Vector3d& place : placed) {
    const bool check = report.points >= options.points;
    const std::string name = (check ? "C" : "P") + std::to_string(++report.points);
    Eigen::Vector3d surveyed = place;
    for (double& x : surveyed) x += random.gauss(options.sigma);
    points.stream() << name
                    << formatted(",%.4f,%.4f,%.4f,%.4f,%s\n", surveyed.x(), surveyed.y(), surveyed.z(),
                                 options.sigma, check ? "check" : "control");
    mark(name, place);
  }
  for (const Eigen::Vector3d& from : seabed.spread(options.bars, random)) {
    std::vector<Eigen::Vector3d> ends = seabed.places();
    std::ranges::sort(
        ends, {}, [&](const Eigen::Vector3d& p) { return std::abs((p - from).norm() - options.bar_length); });
    const Eigen::Vector3d to = *std::ranges::find_if(
        ends, [&](const Eigen::Vector3d& p) { return seabed.viewsOf(p).size() >= kLeastViews; });
    const std::string name = "B" + std::to_string(++report.bars);
    mark(name + "a", from);
    mark(name + "b", to);
    bars.stream() << name << "a," << name << 'b'
                  << formatted(",%.5f,%.5f\n", (to - from).norm() + random.gauss(options.bar_sigma),
                               options.bar_sigma);
  }
  points.commit();
  marks.commit();
  bars.commit();
  return report;
}

}  // namespace fathom::sim
