#include "recon/compare/surface_file.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <string_view>

#include "realtime/base/input_error.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/ply.hpp"

namespace fathom::compare {
namespace {

std::string lowerExtension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

class MeshSurface final : public SurfaceFile {
 public:
  MeshSurface(const std::filesystem::path& path, const std::string& crs, const FrameBeside& beside)
      : mesh_(readPly(path)) {
    if (!crs.empty())
      frame_ = frameFrom(crs, path.string());
    else if (beside)
      frame_ = beside(path);
    if (mesh_.empty()) throw InputError(path.string(), "", "has no triangles: no surface to compare");
    about_ = "mesh of " + std::to_string(mesh_.triangles.size()) + " triangles";
  }

  PlaneFrame frame() const override { return frame_; }

  Box bounds(const PlaneFrame& to) const override {
    constexpr double kFar = std::numeric_limits<double>::infinity();
    Box box{kFar, kFar, -kFar, -kFar};
    for (const Eigen::Vector3f& v : mesh_.vertices) {
      const double east = static_cast<double>(v.y()), north = static_cast<double>(v.x());
      box = {std::min(box.west, east), std::min(box.south, north), std::max(box.east, east),
             std::max(box.north, north)};
    }
    return PlaneTransform(frame_, to).apply(box);
  }

  double spacing(const PlaneFrame&) const override {
    double sum = 0;
    for (const auto& t : mesh_.triangles)
      for (std::size_t k = 0; k < 3; ++k)
        sum += static_cast<double>((mesh_.vertices[t[k]] - mesh_.vertices[t[(k + 1) % 3]]).head<2>().norm());
    return std::max(sum / (3.0 * static_cast<double>(mesh_.triangles.size())), 1e-3);
  }

  HeightMap read(const PlaneFrame& to, const Box& box, double cell) const override {
    // Read out at about the triangles' own size, then averaged: a cell's middle alone would alias.
    const int finer = std::clamp(static_cast<int>(std::ceil(cell / spacing(to))), 1, 64);
    HeightMap coarse(box, cell);
    HeightMap fine = coarse;
    fine.cell = cell / finer;
    fine.columns *= finer;
    fine.rows *= finer;
    const std::size_t size = static_cast<std::size_t>(fine.columns) * static_cast<std::size_t>(fine.rows);
    fine.up.assign(size, std::numeric_limits<float>::quiet_NaN());
    if (!mesh_.sigma.empty()) fine.sigma = fine.up;

    std::vector<double> east, north;
    for (const Eigen::Vector3f& v : mesh_.vertices) {
      east.push_back(static_cast<double>(v.y()));
      north.push_back(static_cast<double>(v.x()));
    }
    PlaneTransform(frame_, to).apply(east, north);
    for (const auto& t : mesh_.triangles) draw(t, east, north, fine);
    return fine.coarser(finer);
  }

 private:
  // The upper surface at each cell's middle.
  void draw(const std::array<std::uint32_t, 3>& t, const std::vector<double>& east,
            const std::vector<double>& north, HeightMap& map) const {
    std::array<Eigen::Vector2d, 3> p;  // (row, column)
    for (std::size_t k = 0; k < 3; ++k) {
      p[k] = {(map.north - north[t[k]]) / map.cell - 0.5, (east[t[k]] - map.west) / map.cell - 0.5};
      if (!p[k].allFinite()) return;
    }
    scanTriangle(p, map.rows, map.columns, [&](int row, int column, const std::array<double, 3>& shares) {
      const auto between = [&](auto&& value) {
        double sum = 0;
        for (std::size_t k = 0; k < 3; ++k) sum += shares[k] * static_cast<double>(value(t[k]));
        return static_cast<float>(sum);
      };
      const float up = between([&](std::uint32_t v) { return -mesh_.vertices[v].z(); });
      const std::size_t at = map.index(column, row);
      if (map.up[at] >= up) return;
      map.up[at] = up;
      if (!mesh_.sigma.empty()) map.sigma[at] = between([&](std::uint32_t v) { return mesh_.sigma[v]; });
    });
  }

  Mesh mesh_;
  PlaneFrame frame_;
};

constexpr std::size_t kMostPoints = 200'000'000;  // 4.8 GB of memory

// Three numbers at the line's begin, divided by blanks, tabs, commas or semicolons.
bool threeNumbers(const std::string& line, double (&xyz)[3]) {
  const char* at = line.c_str();
  for (double& value : xyz) {
    while (*at == ' ' || *at == '\t' || *at == ',' || *at == ';') ++at;
    char* end = nullptr;
    value = std::strtod(at, &end);
    if (end == at || !std::isfinite(value)) return false;
    at = end;
  }
  return true;
}

class PointSurface final : public SurfaceFile {
 public:
  PointSurface(const std::filesystem::path& path, const std::string& crs) {
    if (!crs.empty()) frame_ = frameFrom(crs, "--reference-crs");
    std::ifstream in(path);
    if (!in) throw InputError(path.string(), "", "cannot be read");
    std::string line;
    double xyz[3];
    std::size_t refused = 0, first_refused = 0;
    for (std::size_t number = 1; std::getline(in, line); ++number) {
      if (line.empty() || line == "\r" || line[0] == '#' || line[0] == '%') continue;
      if (!threeNumbers(line, xyz)) {
        // One line of titles is usual; with more it is another kind of file.
        if (++refused > 1)
          throw InputError(path.string(), "line " + std::to_string(number),
                           "is not x y z; text of gridded multibeam has three numbers a line");
        first_refused = number;
        continue;
      }
      if (x_.size() == kMostPoints)
        throw InputError(path.string(), "", "holds more than 200 million points; grid it");
      x_.push_back(xyz[0]);
      y_.push_back(xyz[1]);
      z_.push_back(static_cast<float>(xyz[2]));
    }
    if (refused > 0 && first_refused > 1 && x_.empty())
      throw InputError(path.string(), "line " + std::to_string(first_refused), "is not x y z");
    if (x_.size() < 4)
      throw InputError(path.string(), "", "holds fewer than four points: no surface to compare");
    about_ = std::to_string(x_.size()) + " points";
  }

  PlaneFrame frame() const override { return frame_; }

  Box bounds(const PlaneFrame& to) const override {
    const auto [west, east] = std::minmax_element(x_.begin(), x_.end());
    const auto [south, north] = std::minmax_element(y_.begin(), y_.end());
    return PlaneTransform(frame_, to).apply(Box{*west, *south, *east, *north});
  }

  // As of a lattice with as many points on the area that they occupy: the area of those squares of a coarse
  // raster that hold any.
  double spacing(const PlaneFrame& to) const override {
    const auto [x, y] = transformed(to);
    double west = INFINITY, south = INFINITY, east = -INFINITY, north = -INFINITY;
    for (std::size_t i = 0; i < x.size(); ++i) {
      if (!std::isfinite(x[i])) continue;
      west = std::min(west, x[i]), east = std::max(east, x[i]);
      south = std::min(south, y[i]), north = std::max(north, y[i]);
    }
    if (!(east > west) || !(north > south)) return 1.0;
    const double mean = std::sqrt((east - west) * (north - south) / static_cast<double>(x.size()));
    const double square = 4 * mean;
    const auto columns = static_cast<std::size_t>((east - west) / square) + 1;
    const auto rows = static_cast<std::size_t>((north - south) / square) + 1;
    std::vector<std::uint8_t> held(columns * rows, 0);
    for (std::size_t i = 0; i < x.size(); ++i)
      if (std::isfinite(x[i]))
        held[static_cast<std::size_t>((y[i] - south) / square) * columns +
             static_cast<std::size_t>((x[i] - west) / square)] = 1;
    const double area = square * square * static_cast<double>(std::count(held.begin(), held.end(), 1));
    return std::sqrt(std::min(area, (east - west) * (north - south)) / static_cast<double>(x.size()));
  }

  // The mean of a cell's points, brought from their mean place to the cell's middle along the slope of the
  // cells around: a lattice of points beside the lattice of cells would shift the terrain by up to half a
  // cell. Empty cells between points on both sides, which such lattices leave, get the plane through those.
  HeightMap read(const PlaneFrame& to, const Box& box, double cell) const override {
    const auto [x, y] = transformed(to);
    HeightMap map(box, cell);
    std::vector<Means> means(map.up.size());
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double column = std::floor((x[i] - map.west) / cell), row = std::floor((map.north - y[i]) / cell);
      if (!(column >= 0 && row >= 0 && column < map.columns && row < map.rows)) continue;
      const int c = static_cast<int>(column), r = static_cast<int>(row);
      Means& m = means[map.index(c, r)];
      ++m.count;
      m.place += (Eigen::Vector2d(x[i] - map.eastOf(c), y[i] - map.northOf(r)) - m.place) / m.count;
      m.up += (static_cast<double>(z_[i]) - m.up) / m.count;
    }
    for (int row = 0; row < map.rows; ++row)
      for (int column = 0; column < map.columns; ++column)
        map.up[map.index(column, row)] = static_cast<float>(heightAt(map, means, column, row));
    return map;
  }

 private:
  struct Means {
    double count = 0, up = 0;
    Eigen::Vector2d place = Eigen::Vector2d::Zero();  // from the cell's middle [m]
  };

  static double heightAt(const HeightMap& map, const std::vector<Means>& means, int column, int row) {
    const Means& own = means[map.index(column, row)];
    const auto filled = [&](int dx, int dy) {
      const int c = column + dx, r = row + dy;
      return c >= 0 && r >= 0 && c < map.columns && r < map.rows && means[map.index(c, r)].count > 0;
    };
    const bool between = (filled(-1, 0) && filled(1, 0)) || (filled(0, -1) && filled(0, 1));
    if (own.count == 0 && !between) return std::numeric_limits<double>::quiet_NaN();
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        if (!filled(dx, dy)) continue;
        const Means& m = means[map.index(column + dx, row + dy)];
        const Eigen::Vector3d at(1, m.place.x() / map.cell + dx, m.place.y() / map.cell - dy);
        normal += at * at.transpose();
        right += at * m.up;
      }
    }
    // Too few or all in a line: the plane is level there.
    constexpr double kLevel = 1e-3;
    normal(1, 1) += kLevel;
    normal(2, 2) += kLevel;
    const Eigen::Vector3d plane = normal.ldlt().solve(right);
    return own.count > 0 ? own.up - plane.tail<2>().dot(own.place) / map.cell : plane[0];
  }

  std::pair<std::vector<double>, std::vector<double>> transformed(const PlaneFrame& to) const {
    std::pair<std::vector<double>, std::vector<double>> xy{x_, y_};
    PlaneTransform(frame_, to).apply(xy.first, xy.second);
    return xy;
  }

  PlaneFrame frame_;
  std::vector<double> x_, y_;
  std::vector<float> z_;
};

}  // namespace

std::unique_ptr<SurfaceFile> openSurface(const std::filesystem::path& path, const std::string& crs,
                                         const FrameBeside& beside) {
  std::error_code error;
  if (!std::filesystem::exists(path, error))
    throw InputError(path.string(), "",
                     "is absent; name a folder of fathom-topside, a GeoTIFF, PLY or XYZ file");
  if (std::filesystem::is_directory(path, error)) {
    for (const char* name : {"layers/elevation.tif", "mesh.ply"})
      if (std::filesystem::exists(path / name, error)) return openSurface(path / name, crs, beside);
    throw InputError(path.string(), "",
                     "holds neither layers/elevation.tif nor mesh.ply; run fathom-topside first");
  }
  const std::string extension = lowerExtension(path);
  if (extension == ".ply") return openMesh(path, crs, beside);
  constexpr std::array<std::string_view, 6> kText = {".xyz", ".txt", ".csv", ".pts", ".dat", ".xyb"};
  if (std::find(kText.begin(), kText.end(), extension) != kText.end()) return openPoints(path, crs);
  return openRaster(path, crs);
}

std::unique_ptr<SurfaceFile> openMesh(const std::filesystem::path& path, const std::string& crs,
                                      const FrameBeside& beside) {
  return std::make_unique<MeshSurface>(path, crs, beside);
}

std::unique_ptr<SurfaceFile> openPoints(const std::filesystem::path& path, const std::string& crs) {
  return std::make_unique<PointSurface>(path, crs);
}

}  // namespace fathom::compare
