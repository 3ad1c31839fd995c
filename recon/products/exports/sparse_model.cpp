#include "recon/products/exports/sparse_model.hpp"

#include <bit>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/output_folder.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/geometry/sensor_samples.hpp"

namespace fathom::topside {

SE3 worldFromNav() {
  Eigen::Matrix3d R;
  R << 0, 1, 0, 1, 0, 0, 0, 0, -1;  // east, north, up of north, east, down
  return {R, Eigen::Vector3d::Zero()};
}

std::string originText(const SparseModel& model) {
  if (!model.origin)
    return "World: x east, y north, z up [m]; nobody says where on the Earth: placed by: none\n";
  const double latitude = model.origin->latitude * kDegreesPerRadian,
               longitude = model.origin->longitude * kDegreesPerRadian;
  return formatted(
      "World: x east, y north, z up [m]; z is minus the depth.\n"
      "Origin (WGS84): latitude %.9f, longitude %.9f, placed by: %s\n"
      "x and y as a coordinate system: +proj=tmerc +lat_0=%.9f +lon_0=%.9f +k=1 +x_0=0 +y_0=0 +datum=WGS84 "
      "+units=m +no_defs\n",
      latitude, longitude, model.placed_by.c_str(), latitude, longitude);
}

double SparseModel::meanError() const {
  double sum = 0;
  for (const SparsePoint& point : points) sum += static_cast<double>(point.error) * point.views;
  return members.empty() ? 0 : sum / static_cast<double>(members.size());
}

std::array<double, 2> pixelErrors(const StereoRig& rig, const SE3& T_world_cam,
                                  const closure::Feature& feature, const Eigen::Vector3d& place) {
  const Eigen::Vector3d left = T_world_cam.inverse() * place, right = rig.T_right_left * left;
  constexpr double kNever = std::numeric_limits<double>::infinity();
  if (left.z() <= 0 || right.z() <= 0) return {kNever, kNever};
  return {(rig.left.project(left) - feature.left.cast<double>()).norm(),
          (rig.right.project(right) - feature.right.cast<double>()).norm()};
}

namespace {

static_assert(std::endian::native == std::endian::little, "COLMAP's files are written as they are in memory");

constexpr std::array<std::string_view, 7> kColmapFiles = {
    "cameras.bin", "images.bin", "points3D.bin", "cameras.txt", "images.txt", "points3D.txt", "origin.txt"};

struct ColmapCamera {
  int model;  // COLMAP's number of it
  const char* name;
  std::vector<double> parameters;
};

ColmapCamera colmapCamera(const Camera& c) {
  ColmapCamera out{4, "OPENCV", {c.fx, c.fy, c.cx + kHalfPixel, c.cy + kHalfPixel, c.k1, c.k2, c.p1, c.p2}};
  if (c.k3 == 0) return out;
  out.model = 6;
  out.name = "FULL_OPENCV";
  out.parameters.insert(out.parameters.end(), {c.k3, 0, 0, 0});
  return out;
}

// One of the three files: numbers as they are in memory, or words and lines.
class Table {
 public:
  Table(const std::filesystem::path& folder, const char* name, ColmapFormat format)
      : text_(format == ColmapFormat::kText),
        file_(folder / (std::string(name) + (text_ ? ".txt" : ".bin"))) {}

  void count(std::uint64_t rows) {  // the text has none: its rows are counted
    if (!text_) number(rows);
  }
  template <typename Number>
  void number(Number value) {
    if (!text_) {
      char bytes[sizeof value];
      std::memcpy(bytes, &value, sizeof value);
      file_.stream().write(bytes, sizeof bytes);
    } else if constexpr (std::is_floating_point_v<Number>) {
      word(formatted("%.17g", static_cast<double>(value)));
    } else {
      word(std::to_string(value));
    }
  }
  void name(const std::string& value) {
    if (text_)
      word(value);
    else
      file_.stream().write(value.c_str(), static_cast<std::streamsize>(value.size() + 1));
  }
  void line() {
    if (text_) file_.stream() << '\n';
    begun_ = false;
  }
  [[nodiscard]] bool text() const { return text_; }
  void commit() { file_.commit(); }

 private:
  void word(const std::string& value) {
    if (begun_) file_.stream() << ' ';
    file_.stream() << value;
    begun_ = true;
  }
  bool text_, begun_ = false;
  AtomicFile file_;
};

void writeCameras(const std::filesystem::path& folder, const StereoRig& rig, ColmapFormat format) {
  Table table(folder, "cameras", format);
  table.count(2);
  std::uint32_t id = 0;
  for (const Camera* camera : {&rig.left, &rig.right}) {
    const ColmapCamera out = colmapCamera(*camera);
    table.number(++id);
    if (table.text())
      table.name(out.name);
    else
      table.number(static_cast<std::int32_t>(out.model));
    table.number(static_cast<std::uint64_t>(camera->width));
    table.number(static_cast<std::uint64_t>(camera->height));
    for (const double value : out.parameters) table.number(value);
    table.line();
  }
  table.commit();
}

std::uint32_t imageId(std::size_t view, CameraSide side) {
  return static_cast<std::uint32_t>(2 * view + (side == CameraSide::kLeft ? 1 : 2));
}

void writeImages(const std::filesystem::path& folder, const SparseModel& model, ColmapFormat format) {
  Table table(folder, "images", format);
  table.count(2 * model.views.size());
  for (std::size_t v = 0; v < model.views.size(); ++v)
    for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
      const StereoView& view = model.views[v];
      const bool left = side == CameraSide::kLeft;
      const SE3 T_left_world = view.T_world_cam.inverse();
      const SE3 pose = left ? T_left_world : model.rig.T_right_left * T_left_world;
      table.number(imageId(v, side));
      const Eigen::Quaterniond& q = pose.rotation();
      for (const double value : {q.w(), q.x(), q.y(), q.z()}) table.number(value);
      for (const double value : pose.translation()) table.number(value);
      table.number(static_cast<std::uint32_t>(left ? 1 : 2));
      const std::string& name = left ? view.left : view.right;
      if (table.text() && name.find(' ') != std::string::npos)
        throw InputError(name, "", "has a space, which COLMAP's text form cannot hold; leave --text away");
      table.name(name);
      table.line();
      table.count(view.features.size());
      for (std::size_t k = 0; k < view.features.size(); ++k) {
        const Eigen::Vector2f& pixel = left ? view.features[k].left : view.features[k].right;
        table.number(static_cast<double>(pixel.x()) + kHalfPixel);
        table.number(static_cast<double>(pixel.y()) + kHalfPixel);
        table.number(std::uint64_t{view.point_of[k]} + 1);
      }
      table.line();
    }
  table.commit();
}

void writePoints(const std::filesystem::path& folder, const SparseModel& model, ColmapFormat format) {
  Table table(folder, "points3D", format);
  table.count(model.points.size());
  for (std::size_t k = 0; k < model.points.size(); ++k) {
    const SparsePoint& point = model.points[k];
    table.number(std::uint64_t{k} + 1);
    for (const double value : point.place) table.number(value);
    for (const std::uint8_t channel : point.colour) table.number(channel);
    table.number(static_cast<double>(point.error));
    table.count(2 * std::uint64_t{point.views});
    for (std::uint32_t i = point.first; i < point.first + point.views; ++i)
      for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
        table.number(imageId(model.members[i].view, side));
        table.number(model.members[i].feature);
      }
    table.line();
  }
  table.commit();
}

}  // namespace

void writeColmapModel(const std::filesystem::path& folder, const SparseModel& model, ColmapFormat format) {
  OutputFolder out(folder, kColmapFiles);
  writeCameras(out.path(), model.rig, format);
  writeImages(out.path(), model, format);
  writePoints(out.path(), model, format);
  writeFile(out.path() / "origin.txt", originText(model));
  out.commit();
}

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
