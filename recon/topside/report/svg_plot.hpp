#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

namespace fathom::topside {

struct PlotAxes {
  double width = 420, height = 320;  // of the drawing, without its margins [px]
  double left = 0, right = 1;        // values at the ends
  double bottom = 0, top = 1;        // bottom > top: y grows downwards, as in an image
  std::string x_label, y_label, title;
};

// A drawing with axes, as SVG that stands alone.
class SvgPlot {
 public:
  explicit SvgPlot(PlotAxes axes);

  void dots(const std::vector<Eigen::Vector2d>& at, double radius_px, const std::string& colour,
            double opacity = 1.0);
  void line(const std::vector<Eigen::Vector2d>& along, const std::string& colour, double width_px = 1.5,
            bool dashed = false);
  void segment(const Eigen::Vector2d& from, const Eigen::Vector2d& to, const std::string& colour,
               double width_px = 1.0);
  // Filled, corners at values.
  void rectangle(const Eigen::Vector2d& one, const Eigen::Vector2d& other, const std::string& colour,
                 const std::string& tip = "");
  // k standard deviations about the mean of a Gaussian.
  void ellipse(const Eigen::Vector2d& mean, const Eigen::Matrix2d& covariance, double k,
               const std::string& colour);
  void text(const Eigen::Vector2d& at, const std::string& words, const std::string& colour = "#1b2733",
            double size_px = 11);

  [[nodiscard]] std::string svg() const;

 private:
  [[nodiscard]] Eigen::Vector2d toPage(const Eigen::Vector2d& value) const;
  PlotAxes axes_;
  std::string body_;
};

// Bars of how many values fall into each of `bins` equal parts of [low, high]; the outermost also hold what
// lies beyond.
[[nodiscard]] std::string histogramSvg(const std::vector<double>& values, double low, double high, int bins,
                                       const std::string& x_label, const std::string& title);

// Several drawings as one SVG, so many in a row.
[[nodiscard]] std::string besideEachOther(std::span<const std::string> plots, std::size_t in_a_row);

// Colour of a value from blue (-1) over white to red (+1), as #rrggbb.
[[nodiscard]] std::string divergingColour(double value);
// One of a dozen colours that tell neighbours apart.
[[nodiscard]] std::string distinctColour(std::size_t index);

}  // namespace fathom::topside
