#include "recon/products/exports/nerfstudio_scene.hpp"

#include <nlohmann/json.hpp>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/output_folder.hpp"
#include "recon/geometry/ply_writer.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
constexpr std::array<std::string_view, 3> kNerfFiles = {"transforms.json", "points.ply", "origin.txt"};

Json frameOf(const std::string& path, const Camera& c, const SE3& T_world_cam) {
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  // OpenGL's camera: x right, y up, z backwards.
  pose.topLeftCorner<3, 3>() = T_world_cam.matrix3() * Eigen::Vector3d(1, -1, -1).asDiagonal();
  pose.topRightCorner<3, 1>() = T_world_cam.translation();
  Json rows = Json::array();
  for (const auto& row : pose.rowwise()) rows.push_back({row[0], row[1], row[2], row[3]});
  return {{"file_path", path},
          {"w", c.width},
          {"h", c.height},
          {"fl_x", c.fx},
          {"fl_y", c.fy},
          {"cx", c.cx + kHalfPixel},
          {"cy", c.cy + kHalfPixel},
          {"k1", c.k1},
          {"k2", c.k2},
          {"k3", c.k3},
          {"p1", c.p1},
          {"p2", c.p2},
          {"transform_matrix", rows}};
}

}  // namespace

void writeNerfstudioScene(const fs::path& folder, const SparseModel& model, const fs::path& images) {
  OutputFolder out(folder, kNerfFiles);
  const fs::path away = fs::relative(fs::absolute(images), fs::absolute(folder));
  Json frames = Json::array();
  const SE3 T_left_right = model.rig.T_right_left.inverse();
  for (const StereoView& view : model.views) {
    frames.push_back(frameOf((away / view.left).generic_string(), model.rig.left, view.T_world_cam));
    frames.push_back(
        frameOf((away / view.right).generic_string(), model.rig.right, view.T_world_cam * T_left_right));
  }
  Json scene{{"camera_model", "OPENCV"}};
  if (!model.points.empty()) {
    Mesh points;
    for (const SparsePoint& point : model.points) {
      points.vertices.emplace_back(point.place.cast<float>());
      points.colours.push_back(point.colour);
    }
    writePly(out.path() / "points.ply", points);
    scene["ply_file_path"] = "points.ply";
  }
  scene["frames"] = std::move(frames);
  writeFile(out.path() / "transforms.json", scene.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
  writeFile(out.path() / "origin.txt", originText(model));
  out.commit();
}

}  // namespace fathom::topside
