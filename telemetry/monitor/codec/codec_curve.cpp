#include <algorithm>
#include <array>
#include <cmath>

#include "realtime/kernel/text.hpp"
#include "telemetry/monitor/codec/codec_report.hpp"

namespace fathom::monitor {
namespace {

constexpr double kWidth = 760, kHeight = 480;                        // of the picture [px]
constexpr double kLeft = 70, kRight = 205, kTop = 50, kBottom = 60;  // margins
constexpr std::array<const char*, 6> kColours{"#0b5cad", "#c2410c", "#7c3aed",
                                              "#a16207", "#15803d", "#0e9a9a"};

// "1.5" for 1.5 and "2" for 2.
std::string shortNumber(double value) {
  return formatted("%g", value);
}

struct Axes {
  double x0 = 0, x1 = 0, y0 = 0, y1 = 0;  // logarithms of the ends
  [[nodiscard]] double x(double error) const {
    return kLeft + (std::log(error) - x0) / (x1 - x0) * (kWidth - kLeft - kRight);
  }
  [[nodiscard]] double y(double bytes) const {
    return kHeight - kBottom - (std::log(bytes) - y0) / (y1 - y0) * (kHeight - kTop - kBottom);
  }
};

struct Line {
  std::string name;
  std::vector<std::pair<double, double>> points;  // error [m], bytes a square metre
};

std::string text(double x, double y, const std::string& anchor, const std::string& what,
                 const char* more = "") {
  return "<text x=\"" + shortNumber(x) + "\" y=\"" + shortNumber(y) + "\" text-anchor=\"" + anchor + "\" " +
         more + ">" + what + "</text>\n";
}

}  // namespace

std::string drawCurve(const std::vector<CurvePoint>& points, double area, const std::string& title) {
  std::vector<Line> lines{{"map packets in frames", {}}};
  for (const CurvePoint& point : points) {
    lines[0].points.emplace_back(point.max_error, point.ours);
    for (std::size_t k = 0; k < point.peers.size(); ++k) {
      if (lines.size() < k + 2) lines.push_back({point.peers[k].name, {}});
      if (point.peers[k].bytes > 0)
        lines[k + 1].points.emplace_back(point.max_error, static_cast<double>(point.peers[k].bytes) / area);
    }
  }
  double least = 1e9, most = 0;
  for (const Line& line : lines) {
    for (const auto& [error, bytes] : line.points) {
      least = std::min(least, bytes);
      most = std::max(most, bytes);
    }
  }
  const Axes axes{std::log(points.front().max_error), std::log(points.back().max_error),
                  std::log(least * 0.8), std::log(most * 1.2)};
  std::string svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" + shortNumber(kWidth) +
                    "\" height=\"" + shortNumber(kHeight) +
                    "\" font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" "
                    "fill=\"white\"/>\n";
  svg += text(kLeft, 28, "start", markupText(title), "font-size=\"15\" font-weight=\"bold\"");
  for (const double tick : {0.01, 0.02, 0.03, 0.05, 0.1, 0.2}) {
    const double x = axes.x(tick);
    svg += "<line x1=\"" + shortNumber(x) + "\" x2=\"" + shortNumber(x) + "\" y1=\"" + shortNumber(kTop) +
           "\" y2=\"" + shortNumber(kHeight - kBottom) + "\" stroke=\"#ddd\"/>\n";
    svg += text(x, kHeight - kBottom + 20, "middle", shortNumber(tick * 100));
  }
  for (const double tick : {0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0}) {
    if (std::log(tick) < axes.y0 || std::log(tick) > axes.y1) continue;
    const double y = axes.y(tick);
    svg += "<line x1=\"" + shortNumber(kLeft) + "\" x2=\"" + shortNumber(kWidth - kRight) + "\" y1=\"" +
           shortNumber(y) + "\" y2=\"" + shortNumber(y) + "\" stroke=\"#ddd\"/>\n";
    svg += text(kLeft - 8, y + 4, "end", shortNumber(tick));
  }
  svg += text((kLeft + kWidth - kRight) / 2, kHeight - 16, "middle", "largest height error [cm]");
  svg += text(0, 0, "middle", "bytes per square metre", "transform=\"translate(20,230) rotate(-90)\"");
  // Names at the lines' right ends, pushed apart.
  std::vector<std::pair<double, std::size_t>> ends;
  for (std::size_t k = 0; k < lines.size(); ++k) {
    if (lines[k].points.empty()) continue;
    std::string path;
    for (const auto& [error, bytes] : lines[k].points)
      path += (path.empty() ? "" : " ") + shortNumber(axes.x(error)) + "," + shortNumber(axes.y(bytes));
    svg += "<polyline points=\"" + path + "\" fill=\"none\" stroke=\"" + kColours[k % kColours.size()] +
           "\" stroke-width=\"" + (k == 0 ? "3" : "1.6") + "\"/>\n";
    ends.emplace_back(axes.y(lines[k].points.back().second), k);
  }
  std::sort(ends.begin(), ends.end());
  double above = 0;
  for (const auto& [y, k] : ends) {
    constexpr double kLine = 17;  // height of a name [px]
    const double at = std::max(y, above + kLine);
    above = at;
    svg += "<text x=\"" + shortNumber(kWidth - kRight + 8) + "\" y=\"" + shortNumber(at + 4) + "\" fill=\"" +
           kColours[k % kColours.size()] + "\"" + (k == 0 ? " font-weight=\"bold\"" : "") + ">" +
           markupText(lines[k].name) + "</text>\n";
  }
  return svg + "</svg>\n";
}

}  // namespace fathom::monitor
