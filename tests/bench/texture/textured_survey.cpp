#include "tests/bench/texture/textured_survey.hpp"

#include <ctime>
#include <unordered_map>

#include "firmware_if/pose_files.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "recon/surface/simplify.hpp"
#include "recon/surface/view_projection.hpp"

namespace fathom::surface {
namespace {

constexpr std::size_t kKept = 120;       // images, 5 MB each at full size
constexpr double kPoseTime = 0.02;       // [s] between an image and its line in the pose file
constexpr double kFootprintSlack = 1.4;  // over the pose file's radius: a slope, and the image's corners

// CPU time of this thread [s].
double now() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

}  // namespace

TexturedSurvey::TexturedSurvey(const std::filesystem::path& mission, const std::filesystem::path& model)
    : input_(topside::openMission(mission, {})),
      models_(input_.mission, input_.rig, config_.lighting),
      mesh_(readPly(model / "mesh.ply")) {
  const io::StereoPoseFile stereo = io::readStereoPoses(model / "stereo_pose_est.data");
  const io::VehiclePoseFile vehicle = io::readVehiclePoses(model / "vehicle_pose_est.data");
  topside::Survey survey;
  survey.list = topside::listPairs(input_.paths, input_.mission, config_.pairing_tolerance);
  std::unordered_map<std::string, const io::StereoPose*> by_name;
  for (const io::StereoPose& pose : stereo.poses) by_name[pose.left_image] = &pose;

  std::vector<View> views;
  for (const topside::ImagePair& pair : survey.list.pairs) {
    topside::NavigatedPose& pose = survey.navigation.poses.emplace_back();
    pose.utc_ns = pair.utc_ns;
    const auto found = by_name.find(pair.left);
    if (found == by_name.end()) continue;
    const io::StereoPose& seen = *found->second;
    for (const io::VehiclePose& body : vehicle.poses) {
      if (std::abs(body.utc_s - seen.utc_s) > kPoseTime) continue;
      pose.T_nav_body = body.T_nav_body;
      if (seen.altitude > 0) pose.altitude = seen.altitude;
    }
    const Eigen::Vector3d middle =
        seen.T_nav_cam * Eigen::Vector3d(0, 0, seen.altitude > 0 ? seen.altitude : config_.default_altitude);
    const double reach = kFootprintSlack * seen.footprint_radius;
    views.push_back({static_cast<std::uint32_t>(pairs_.size()),
                     seen.T_nav_cam,
                     {middle.x() - reach, middle.y() - reach, middle.x() + reach, middle.y() + reach}});
    pairs_.push_back(pair);
    altitudes_.push_back(seen.altitude > 0 ? seen.altitude : config_.default_altitude);
    poses_.push_back(seen.T_nav_cam);
  }
  if (pairs_.empty())
    throw InputError((model / "stereo_pose_est.data").string(), "", "no image of the mission has a pose");
  index_.emplace(std::move(views));
  topside::learnLighting(input_, config_, survey, models_);
  images_.emplace(input_, models_);
}

TileMesh TexturedSurvey::tileAt(const std::array<double, 4>& box, double triangles_per_m2) const {
  TileMesh tile;
  std::vector<std::uint32_t> place(mesh_.vertices.size(), 0);
  for (const auto& t : mesh_.triangles) {
    const Eigen::Vector3f middle =
        (mesh_.vertices[t[0]] + mesh_.vertices[t[1]] + mesh_.vertices[t[2]]) / 3.0F;
    if (middle.x() < box[0] || middle.y() < box[1] || middle.x() >= box[2] || middle.y() >= box[3]) continue;
    std::array<std::uint32_t, 3> corners{};
    for (std::size_t k = 0; k < 3; ++k) {
      std::uint32_t& at = place[t[k]];
      if (at == 0) {
        const Eigen::Vector3f& v = mesh_.vertices[t[k]];
        tile.mesh.vertices.emplace_back(static_cast<float>(TileGrid::snap(v.x())),
                                        static_cast<float>(TileGrid::snap(v.y())),
                                        static_cast<float>(TileGrid::snap(v.z())));
        if (!mesh_.colours.empty()) tile.mesh.colours.push_back(mesh_.colours[t[k]]);
        at = static_cast<std::uint32_t>(tile.mesh.vertices.size());
      }
      corners[k] = at - 1;
    }
    tile.mesh.triangles.push_back(corners);
  }
  tile.shared.assign(tile.mesh.vertices.size(), 0);
  computeNormals(tile.mesh);
  return triangles_per_m2 > 0 ? simplify(tile, triangles_per_m2) : tile;
}

std::shared_ptr<const BandImage> TexturedSurvey::bandsOf(std::uint32_t image, const BandWidths& widths) {
  const std::pair<std::uint32_t, bool> key{image, widths.restore};
  if (const auto found = kept_.find(key); found != kept_.end()) {
    order_.remove(key);
    order_.push_front(key);
    return found->second;
  }
  // The seafloor as it was fused, in the camera's frame, says how far the light went.
  const SE3 T_cam_nav = poses_[image].inverse();
  const auto& f = index_->views()[image].footprint;
  constexpr std::size_t kEvery = 7;  // vertices: some hundred a picture
  std::vector<Eigen::Vector3f> points;
  for (std::size_t i = 0; i < mesh_.vertices.size(); i += kEvery) {
    const Eigen::Vector3f& v = mesh_.vertices[i];
    if (v.x() < f[0] || v.y() < f[1] || v.x() > f[2] || v.y() > f[3]) continue;
    const Eigen::Vector3d p = T_cam_nav * v.cast<double>();
    if (p.z() > ViewProjection::kNear && camera().contains(camera().project(p)))
      points.emplace_back(p.cast<float>());
  }
  const Eigen::Vector3d down = T_cam_nav.rotation() * Eigen::Vector3d::UnitZ();
  const stereo::SeedPlane plane{down, altitudes_[image]};
  double start = now();
  if (!images_->readLeft(pairs_[image])) return nullptr;
  RgbImage rgb = images_->colours(plane, points);
  read_seconds_ += now() - start;
  start = now();
  auto bands = std::make_shared<const BandImage>(makeBands(std::move(rgb), widths));
  band_seconds_ += now() - start;
  ++made_;
  kept_[key] = bands;
  order_.push_front(key);
  if (order_.size() > kKept) {
    kept_.erase(order_.back());
    order_.pop_back();
  }
  return bands;
}

}  // namespace fathom::surface
