#include "recon/topside/report/stereo_output.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"

namespace fathom::topside {
namespace {

using Json = nlohmann::ordered_json;

std::vector<std::pair<const char*, std::uint32_t>> causes(const stereo::StereoResult::Rejected& r) {
  return {{"no_track", r.no_track}, {"left_right", r.left_right}, {"epipolar", r.epipolar},
          {"range", r.range},       {"outlier", r.outlier},       {"fish", r.fish}};
}

double medianDepth(const stereo::StereoResult& result) {
  std::vector<float> z;
  for (const stereo::StereoPoint& p : result.points) z.push_back(p.point.z());
  return static_cast<double>(median(std::move(z)));
}

// Colours of a scale from near (bright) to far (dark).
cv::Mat depthColours() {
  cv::Mat scale(1, 256, CV_8UC1), colours;
  for (int k = 0; k < scale.cols; ++k) scale.at<std::uint8_t>(0, k) = static_cast<std::uint8_t>(255 - k);
  cv::applyColorMap(scale, colours, cv::COLORMAP_VIRIDIS);
  return colours;
}

void drawScale(cv::Mat& picture, const cv::Mat& colours, double nearest, double farthest) {
  const double unit = picture.cols / 1360.0;  // drawn for the full image, smaller with it
  const int width = static_cast<int>(320 * unit), height = std::max(static_cast<int>(18 * unit), 6);
  const cv::Point at(static_cast<int>(24 * unit), picture.rows - static_cast<int>(60 * unit));
  const cv::Rect box(at.x - 8, at.y - 8, width + 16, static_cast<int>(60 * unit) + 8);
  picture(box & cv::Rect(0, 0, picture.cols, picture.rows)) *= 0.35;
  for (int x = 0; x < width; ++x)
    cv::line(picture, {at.x + x, at.y}, {at.x + x, at.y + height},
             colours.at<cv::Vec3b>(0, x * 255 / std::max(width - 1, 1)));
  const auto label = [&](double metres, int x) {
    cv::putText(picture, formatted("%.2f m", metres), {x, at.y + height + static_cast<int>(26 * unit)},
                cv::FONT_HERSHEY_SIMPLEX, 0.75 * unit, cv::Scalar::all(255),
                std::max(static_cast<int>(2 * unit), 1), cv::LINE_AA);
  };
  label(nearest, at.x);
  label(farthest, at.x + width - static_cast<int>(95 * unit));
}

}  // namespace

void writePointsCsv(const std::filesystem::path& path, const stereo::StereoResult& result) {
  AtomicFile file(path);
  file.stream() << "u_left,v_left,u_right,v_right,x_m,y_m,z_m,sigma_z_m\n";
  for (const stereo::StereoPoint& p : result.points) {
    const auto number = [](float v) { return static_cast<double>(v); };
    file.stream() << formatted("%.3f,%.3f,%.3f,%.3f,%.5f,%.5f,%.5f,%.6f\n", number(p.left.x()),
                               number(p.left.y()), number(p.right.x()), number(p.right.y()),
                               number(p.point.x()), number(p.point.y()), number(p.point.z()),
                               number(p.sigma_z));
  }
  file.commit();
}

std::string pairJson(const stereo::StereoResult& result, const PairReport& report) {
  Json json;
  json["method"] = report.method;
  json["corners"] = result.corners;
  json["points"] = result.points.size();
  json["triangles"] = result.triangles.size();
  json["median_depth_m"] = medianDepth(result);
  Json rejected = Json::object();
  for (const auto& [cause, count] : causes(result.rejected)) rejected[cause] = count;
  json["rejected"] = rejected;
  json["seed_plane"] = {
      {"normal", {report.plane.normal.x(), report.plane.normal.y(), report.plane.normal.z()}},
      {"distance_m", report.plane.distance},
      {"from", report.plane_found ? "wide search" : "altitude"}};
  Json ms = Json::object();
  double total = 0;
  for (const auto& [stage, time] : report.stage_ms) {
    ms[stage] = time;
    total += time;
  }
  ms["total"] = total;
  json["ms"] = ms;
  return json.dump(2);
}

std::string pairText(const stereo::StereoResult& result, const PairReport& report) {
  std::string text = std::to_string(result.points.size()) + " points of " + std::to_string(result.corners) +
                     (report.method == "dense" ? " cells" : " corners") + ", " +
                     std::to_string(result.triangles.size()) + " triangles";
  text += formatted(", median depth %.3f m\nrejected:", medianDepth(result));
  for (const auto& [cause, count] : causes(result.rejected)) {
    text += std::string(" ") + cause + " " + std::to_string(count);
  }
  text += "\nms:";
  for (const auto& [stage, time] : report.stage_ms) {
    text += formatted(" %s %.1f", stage.c_str(), time);
  }
  return text;
}

std::string depthPicture(const stereo::StereoResult& result, const ImageView& left_mono) {
  const cv::Mat grey(left_mono.height, left_mono.width, CV_8UC1, const_cast<void*>(left_mono.data),
                     left_mono.stride);
  cv::Mat picture;
  cv::cvtColor(grey, picture, cv::COLOR_GRAY2BGR);
  if (!result.points.empty()) {
    std::vector<float> depths;
    for (const stereo::StereoPoint& p : result.points) depths.push_back(p.point.z());
    std::sort(depths.begin(), depths.end());
    const double nearest = static_cast<double>(depths[depths.size() / 100]);
    const double farthest = static_cast<double>(depths[(depths.size() - 1) * 99 / 100]);
    const cv::Mat colours = depthColours();
    const auto colourOf = [&](double z) {
      const double s = (z - nearest) / std::max(farthest - nearest, 1e-3);
      return colours.at<cv::Vec3b>(0, static_cast<int>(std::clamp(s, 0.0, 1.0) * 255));
    };
    constexpr int kFraction = 4;  // bits of sub-pixel position that OpenCV draws with
    const auto at = [&](std::uint32_t i) {
      const Eigen::Vector2f pixel = result.points[i].left * static_cast<float>(1 << kFraction);
      return cv::Point(static_cast<int>(pixel.x()), static_cast<int>(pixel.y()));
    };
    cv::Mat overlay = picture.clone();
    for (const auto& t : result.triangles) {
      const cv::Point corners[3] = {at(t[0]), at(t[1]), at(t[2])};
      double z = 0;
      for (const std::uint32_t i : t) z += static_cast<double>(result.points[i].point.z()) / 3;
      cv::fillConvexPoly(overlay, corners, 3, colourOf(z), cv::LINE_AA, kFraction);
    }
    constexpr double kOpacity = 0.55;
    cv::addWeighted(overlay, kOpacity, picture, 1 - kOpacity, 0, picture);
    for (std::uint32_t i = 0; i < result.points.size(); ++i)
      cv::circle(picture, at(i), 2 << kFraction, colourOf(static_cast<double>(result.points[i].point.z())),
                 cv::FILLED, cv::LINE_AA, kFraction);
    drawScale(picture, colours, nearest, farthest);
  }
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".png", picture, bytes)) throw std::runtime_error("a picture cannot be encoded as PNG");
  return {bytes.begin(), bytes.end()};
}

}  // namespace fathom::topside
