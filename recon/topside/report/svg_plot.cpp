#include "recon/topside/report/svg_plot.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <numbers>

#include "realtime/kernel/text.hpp"
#include "recon/geometry/symmetric_eigen.hpp"
#include "recon/topside/report/html_text.hpp"

namespace fathom::topside {
namespace {

constexpr double kLeftMargin = 62, kRightMargin = 14, kTopMargin = 26, kBottomMargin = 44;  // [px]
constexpr int kTicks = 5;  // about, along an axis

// A step of 1, 2 or 5 times a power of ten that gives about kTicks ticks.
double tickStep(double span) {
  const double rough = span / kTicks;
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  for (const double factor : {1.0, 2.0, 5.0})
    if (rough <= factor * power) return factor * power;
  return 10 * power;
}

std::vector<double> ticks(double a, double b) {
  const double low = std::min(a, b), high = std::max(a, b);
  std::vector<double> out;
  if (!(high > low)) return out;
  const double step = tickStep(high - low);
  for (double k = std::ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; ++k) out.push_back(k * step);
  return out;
}

std::string tickText(double value) {
  return formatted("%g", std::abs(value) < 1e-12 ? 0.0 : value);
}

std::string px(double value) {
  return fixedDigits(value, 2);
}

}  // namespace

SvgPlot::SvgPlot(PlotAxes axes) : axes_(std::move(axes)) {}

Eigen::Vector2d SvgPlot::toPage(const Eigen::Vector2d& v) const {
  return {kLeftMargin + (v.x() - axes_.left) / (axes_.right - axes_.left) * axes_.width,
          kTopMargin + (axes_.top - v.y()) / (axes_.top - axes_.bottom) * axes_.height};
}

void SvgPlot::dots(const std::vector<Eigen::Vector2d>& at, double radius, const std::string& colour,
                   double opacity) {
  body_ += "<g fill=\"" + colour + "\" fill-opacity=\"" + px(opacity) + "\">";
  for (const auto& v : at) {
    const Eigen::Vector2d p = toPage(v);
    body_ += "<circle cx=\"" + px(p.x()) + "\" cy=\"" + px(p.y()) + "\" r=\"" + px(radius) + "\"/>";
  }
  body_ += "</g>\n";
}

void SvgPlot::line(const std::vector<Eigen::Vector2d>& along, const std::string& colour, double width,
                   bool dashed) {
  body_ += "<polyline fill=\"none\" stroke=\"" + colour + "\" stroke-width=\"" + px(width) + "\"" +
           (dashed ? " stroke-dasharray=\"6 4\"" : "") + " points=\"";
  for (const auto& v : along) {
    const Eigen::Vector2d p = toPage(v);
    body_ += px(p.x()) + "," + px(p.y()) + " ";
  }
  body_ += "\"/>\n";
}

void SvgPlot::segment(const Eigen::Vector2d& from, const Eigen::Vector2d& to, const std::string& colour,
                      double width) {
  const Eigen::Vector2d a = toPage(from), b = toPage(to);
  body_ += "<line x1=\"" + px(a.x()) + "\" y1=\"" + px(a.y()) + "\" x2=\"" + px(b.x()) + "\" y2=\"" +
           px(b.y()) + "\" stroke=\"" + colour + "\" stroke-width=\"" + px(width) + "\"/>\n";
}

void SvgPlot::rectangle(const Eigen::Vector2d& one, const Eigen::Vector2d& other, const std::string& colour,
                        const std::string& tip) {
  const Eigen::Vector2d a = toPage(one), b = toPage(other);
  const Eigen::Vector2d low = a.cwiseMin(b), size = (a - b).cwiseAbs();
  body_ += "<rect x=\"" + px(low.x()) + "\" y=\"" + px(low.y()) + "\" width=\"" + px(size.x()) +
           "\" height=\"" + px(size.y()) + "\" fill=\"" + colour + "\"";
  body_ += tip.empty() ? "/>\n" : "><title>" + markupText(tip) + "</title></rect>\n";
}

void SvgPlot::ellipse(const Eigen::Vector2d& mean, const Eigen::Matrix2d& covariance, double k,
                      const std::string& colour) {
  const SymmetricEigen<2> eigen = symmetricEigen(covariance);
  const Eigen::Vector2d axes = k * eigen.values.cwiseMax(0.0).cwiseSqrt();
  constexpr int kCorners = 90;
  std::vector<Eigen::Vector2d> along;
  for (int i = 0; i <= kCorners; ++i) {
    const double angle = 2 * std::numbers::pi * i / kCorners;
    along.push_back(mean +
                    eigen.vectors * Eigen::Vector2d(axes.x() * std::cos(angle), axes.y() * std::sin(angle)));
  }
  line(along, colour, 2.0);
}

void SvgPlot::text(const Eigen::Vector2d& at, const std::string& words, const std::string& colour,
                   double size) {
  const Eigen::Vector2d p = toPage(at);
  body_ += "<text x=\"" + px(p.x()) + "\" y=\"" + px(p.y()) + "\" fill=\"" + colour + "\" font-size=\"" +
           px(size) + "\" text-anchor=\"middle\">" + markupText(words) + "</text>\n";
}

std::string SvgPlot::svg() const {
  const double width = axes_.width + kLeftMargin + kRightMargin;
  const double height = axes_.height + kTopMargin + kBottomMargin;
  const double x1 = kLeftMargin + axes_.width, y1 = kTopMargin + axes_.height;
  std::string out = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" + px(width) + "\" height=\"" +
                    px(height) + "\" viewBox=\"0 0 " + px(width) + " " + px(height) +
                    "\" font-family=\"system-ui,sans-serif\" font-size=\"11\" fill=\"#1b2733\">\n"
                    "<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n";
  for (const double tick : ticks(axes_.left, axes_.right)) {
    const double x = toPage({tick, axes_.bottom}).x();
    out += "<line x1=\"" + px(x) + "\" y1=\"" + px(kTopMargin) + "\" x2=\"" + px(x) + "\" y2=\"" + px(y1) +
           "\" stroke=\"#e6ebef\"/><text x=\"" + px(x) + "\" y=\"" + px(y1 + 15) +
           "\" text-anchor=\"middle\">" + tickText(tick) + "</text>\n";
  }
  for (const double tick : ticks(axes_.bottom, axes_.top)) {
    const double y = toPage({axes_.left, tick}).y();
    out += "<line x1=\"" + px(kLeftMargin) + "\" y1=\"" + px(y) + "\" x2=\"" + px(x1) + "\" y2=\"" + px(y) +
           "\" stroke=\"#e6ebef\"/><text x=\"" + px(kLeftMargin - 6) + "\" y=\"" + px(y + 4) +
           "\" text-anchor=\"end\">" + tickText(tick) + "</text>\n";
  }
  // What is drawn ends at the frame.
  out += "<svg x=\"" + px(kLeftMargin) + "\" y=\"" + px(kTopMargin) + "\" width=\"" + px(axes_.width) +
         "\" height=\"" + px(axes_.height) + "\" viewBox=\"" + px(kLeftMargin) + " " + px(kTopMargin) + " " +
         px(axes_.width) + " " + px(axes_.height) + "\">\n" + body_ + "</svg>\n";
  out += "<rect x=\"" + px(kLeftMargin) + "\" y=\"" + px(kTopMargin) + "\" width=\"" + px(axes_.width) +
         "\" height=\"" + px(axes_.height) + "\" fill=\"none\" stroke=\"#8a98a5\"/>\n";
  out += "<text x=\"" + px(kLeftMargin + axes_.width / 2) +
         "\" y=\"17\" text-anchor=\"middle\" font-size=\"13\">" + markupText(axes_.title) +
         "</text>\n<text x=\"" + px(kLeftMargin + axes_.width / 2) + "\" y=\"" + px(height - 8) +
         "\" text-anchor=\"middle\">" + markupText(axes_.x_label) + "</text>\n";
  const double middle = kTopMargin + axes_.height / 2;
  out += "<text transform=\"translate(14 " + px(middle) + ") rotate(-90)\" text-anchor=\"middle\">" +
         markupText(axes_.y_label) + "</text>\n</svg>\n";
  return out;
}

std::string histogramSvg(const std::vector<double>& values, double low, double high, int bins,
                         const std::string& x_label, const std::string& title) {
  std::vector<double> counts(static_cast<std::size_t>(bins), 0.0);
  for (const double v : values) {
    const int bin = static_cast<int>(std::floor((std::clamp(v, low, high) - low) / (high - low) * bins));
    ++counts[static_cast<std::size_t>(std::clamp(bin, 0, bins - 1))];
  }
  const double most = std::max(1.0, *std::max_element(counts.begin(), counts.end()));
  SvgPlot plot({.width = 300,
                .height = 200,
                .left = low,
                .right = high,
                .bottom = 0,
                .top = 1.08 * most,
                .x_label = x_label,
                .y_label = "count",
                .title = title});
  const double step = (high - low) / bins;
  for (int b = 0; b < bins; ++b)
    plot.rectangle({low + b * step, 0}, {low + (b + 0.92) * step, counts[static_cast<std::size_t>(b)]},
                   "#4f86b5");
  return plot.svg();
}

std::string besideEachOther(std::span<const std::string> plots, std::size_t in_a_row) {
  const auto sizeOf = [](const std::string& plot, const char* name) {
    const auto at = plot.find(name);
    return at == std::string::npos ? 0.0 : std::strtod(plot.c_str() + at + std::strlen(name), nullptr);
  };
  std::string body;
  double width = 0, top = 0, row_height = 0, left = 0;
  for (std::size_t k = 0; k < plots.size(); ++k) {
    if (k % in_a_row == 0) top += row_height, row_height = left = 0;
    body += "<g transform=\"translate(" + px(left) + " " + px(top) + ")\">\n" + plots[k] + "</g>\n";
    left += sizeOf(plots[k], "width=\"");
    width = std::max(width, left);
    row_height = std::max(row_height, sizeOf(plots[k], "height=\""));
  }
  return "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" + px(width) + "\" height=\"" +
         px(top + row_height) + "\">\n<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n" + body +
         "</svg>\n";
}

std::string divergingColour(double value) {
  const double v = std::clamp(std::isfinite(value) ? value : 0.0, -1.0, 1.0);
  const std::array<double, 3> end =
      v < 0 ? std::array<double, 3>{33, 102, 172} : std::array<double, 3>{178, 24, 43};
  const auto mix = [&](std::size_t c) {
    return static_cast<int>(std::lround(250 + std::abs(v) * (end[c] - 250)));
  };
  return formatted("#%02x%02x%02x", mix(0) & 255, mix(1) & 255, mix(2) & 255);
}

std::string distinctColour(std::size_t index) {
  static constexpr std::array<const char*, 12> kColours{"#1f77b4", "#d62728", "#2ca02c", "#9467bd",
                                                        "#ff7f0e", "#17becf", "#8c564b", "#e377c2",
                                                        "#7f7f7f", "#bcbd22", "#1b4f72", "#6e2c00"};
  return kColours[index % kColours.size()];
}

}  // namespace fathom::topside
