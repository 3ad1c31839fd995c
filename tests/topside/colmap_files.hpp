#pragma once

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cstring>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "tests/support/text_files.hpp"

namespace fathom::test {

// COLMAP's binary model, read as colmap.github.io/format.html describes it.
struct ColmapFiles {
  struct Camera {
    int model = 0;
    std::uint64_t width = 0, height = 0;
    std::vector<double> p;
    // OPENCV and FULL_OPENCV of COLMAP's models.h.
    [[nodiscard]] Eigen::Vector2d project(const Eigen::Vector3d& in_camera) const {
      const double u = in_camera.x() / in_camera.z(), v = in_camera.y() / in_camera.z(), r2 = u * u + v * v;
      double radial = 1 + p[4] * r2 + p[5] * r2 * r2;
      if (model == 6)
        radial = (radial + p[8] * r2 * r2 * r2) / (1 + p[9] * r2 + p[10] * r2 * r2 + p[11] * r2 * r2 * r2);
      return {p[0] * (u * radial + 2 * p[6] * u * v + p[7] * (r2 + 2 * u * u)) + p[2],
              p[1] * (v * radial + 2 * p[7] * u * v + p[6] * (r2 + 2 * v * v)) + p[3]};
    }
  };
  struct Image {
    Eigen::Quaterniond rotation;
    Eigen::Vector3d translation;
    std::uint32_t camera = 0;
    std::string name;
    std::vector<Eigen::Vector2d> pixels;
    std::vector<std::uint64_t> points;
  };
  struct Point {
    Eigen::Vector3d place;
    std::array<std::uint8_t, 3> colour{};
    double error = 0;
    std::vector<std::pair<std::uint32_t, std::uint32_t>> track;  // image, number of its pixel
  };
  std::map<std::uint32_t, Camera> cameras;
  std::map<std::uint32_t, Image> images;
  std::map<std::uint64_t, Point> points;

  explicit ColmapFiles(const std::filesystem::path& folder) {
    Bytes in(folder / "cameras.bin");
    for (auto n = in.take<std::uint64_t>(); n > 0; --n) {
      Camera& camera = cameras[in.take<std::uint32_t>()];
      camera.model = in.take<std::int32_t>();
      camera.width = in.take<std::uint64_t>();
      camera.height = in.take<std::uint64_t>();
      for (int k = 0; k < (camera.model == 6 ? 12 : 8); ++k) camera.p.push_back(in.take<double>());
    }
    in.end();
    in = Bytes(folder / "images.bin");
    for (auto n = in.take<std::uint64_t>(); n > 0; --n) {
      Image& image = images[in.take<std::uint32_t>()];
      for (double* q : {&image.rotation.w(), &image.rotation.x(), &image.rotation.y(), &image.rotation.z()})
        *q = in.take<double>();
      for (double& t : image.translation) t = in.take<double>();
      image.camera = in.take<std::uint32_t>();
      while (const char c = in.take<char>()) image.name += c;
      for (auto k = in.take<std::uint64_t>(); k > 0; --k) {
        const auto x = in.take<double>(), y = in.take<double>();
        image.pixels.emplace_back(x, y);
        image.points.push_back(in.take<std::uint64_t>());
      }
    }
    in.end();
    in = Bytes(folder / "points3D.bin");
    for (auto n = in.take<std::uint64_t>(); n > 0; --n) {
      Point& point = points[in.take<std::uint64_t>()];
      for (double& x : point.place) x = in.take<double>();
      for (std::uint8_t& c : point.colour) c = in.take<std::uint8_t>();
      point.error = in.take<double>();
      for (auto k = in.take<std::uint64_t>(); k > 0; --k) {
        const auto image = in.take<std::uint32_t>();
        point.track.emplace_back(image, in.take<std::uint32_t>());
      }
    }
    in.end();
  }

  // Mean over a point's track of the distance between where it projects and where it was seen [px].
  [[nodiscard]] double errorOf(const Point& point) const {
    double sum = 0;
    for (const auto& [id, k] : point.track) {
      const Image& image = images.at(id);
      const Eigen::Vector3d in_camera = image.rotation * point.place + image.translation;
      sum += (cameras.at(image.camera).project(in_camera) - image.pixels.at(k)).norm();
    }
    return sum / static_cast<double>(point.track.size());
  }

 private:
  class Bytes {
   public:
    explicit Bytes(const std::filesystem::path& path) : bytes_(readBytes(path)) {}
    template <typename T>
    T take() {
      T value{};
      if (at_ + sizeof value > bytes_.size()) throw std::runtime_error("the file ends early");
      std::memcpy(&value, &bytes_[at_], sizeof value);
      at_ += sizeof value;
      return value;
    }
    void end() const { EXPECT_EQ(at_, bytes_.size()); }

   private:
    std::vector<std::uint8_t> bytes_;
    std::size_t at_ = 0;
  };
};

}  // namespace fathom::test
