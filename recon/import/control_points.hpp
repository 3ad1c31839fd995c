#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "recon/geometry/geodesy.hpp"
#include "recon/import/images/image_pairs.hpp"

namespace fathom::topside {

// What somebody surveyed on the seafloor and marked in images: the three tables of a control folder.
struct ControlPoints {
  struct Point {
    std::string name;
    std::optional<Geodetic> on_earth;      // else `place` is as given; none of both: only bars know of it
    std::optional<Eigen::Vector3d> place;  // in nav: north, east, down [m]
    Eigen::Vector3d sigma = Eigen::Vector3d::Zero();  // standard deviations of the same [m]
    bool check = false;                               // compared with the result, which it has no part in
  };
  // A point's centre in one image.
  struct Mark {
    std::uint32_t point = 0;
    std::string image;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    double sigma = 1;     // of either coordinate [px]
    std::size_t row = 0;  // of marks.csv, from 1
  };
  // A known distance of two points.
  struct Bar {
    std::uint32_t from = 0, to = 0;
    double length = 0, sigma = 0;  // [m]
    bool check = false;
  };
  std::filesystem::path folder;
  std::vector<Point> points;
  std::vector<Mark> marks;
  std::vector<Bar> bars;

  // Of points on Earth.
  void placeAbout(const Geodetic& origin);
  [[nodiscard]] std::optional<Geodetic> firstOnEarth() const;
};

inline constexpr std::array<const char*, 3> kControlTables = {"points.csv", "marks.csv", "scale_bars.csv"};

// Reads FOLDER/points.csv, marks.csv and scale_bars.csv (recon/topside/README.md has the columns). `crs`: of
// eastings and northings, as EPSG:32755. Throws InputError for tables that are absent or damaged, for names
// that stand twice, and for a folder in which no marked point has a place and no bar a length.
[[nodiscard]] ControlPoints readControlPoints(const std::filesystem::path& folder, const std::string& crs);

// A mark in a pair of the dive.
struct ControlSighting {
  std::uint32_t point = 0, pair = 0;
  bool left = true;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma = 1;  // [px]
};
// Images are known by their names, with or without folders. Throws InputError for a mark in an image that the
// dive does not have, or that several have the name of.
[[nodiscard]] std::vector<ControlSighting> sightingsOf(const ControlPoints& control, const PairList& list);

}  // namespace fathom::topside
