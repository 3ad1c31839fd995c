#include "telemetry/monitor/codec/codec_report.hpp"
#include "telemetry/web/report_page.hpp"

namespace fathom::monitor {

void writeCurve(const std::filesystem::path& file, const std::vector<CurvePoint>& points, double area,
                const std::string& about) {
  constexpr double kCentimetres = 100, kThick = 3, kThin = 1.6;  // [px]
  web::Plot plot{.title = "Bytes over the error bound",
                 .x = "largest height error [cm]",
                 .y = "bytes a square metre",
                 .log_x = true,
                 .log_y = true};
  const auto add = [&](const std::string& name, double size, auto bytes) {
    web::Series line{.label = name, .colour = web::distinctColour(plot.series.size()), .size = size};
    for (const CurvePoint& point : points)
      if (const double b = bytes(point); b > 0) line.at.emplace_back(kCentimetres * point.max_error, b);
    plot.series.push_back(std::move(line));
  };
  add("map packets in frames", kThick, [](const CurvePoint& point) { return point.ours; });
  for (std::size_t k = 0; k < points.front().peers.size(); ++k)
    add(points.front().peers[k].name, kThin,
        [&](const CurvePoint& point) { return static_cast<double>(point.peers[k].bytes) / area; });
  web::Report report("The map codec on a surface", about);
  report.plot(plot);
  report.write(file);
}

}  // namespace fathom::monitor
