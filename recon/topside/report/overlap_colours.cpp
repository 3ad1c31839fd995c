#include "recon/topside/report/overlap_colours.hpp"

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/colour.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/topside/dive.hpp"
#include "recon/topside/light/pair_images.hpp"

namespace fathom::topside {
namespace {

struct ComparedCouple {
  std::vector<PlaceColours> before, after;
};

// Couples that share ground: neighbours along the track, and closures.
std::vector<std::pair<std::uint32_t, std::uint32_t>> couplesOf(const SlamResult* slam, std::size_t pairs) {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> out;
  const auto some = [](std::size_t count, const auto& take) {
    const std::size_t most = std::min(count, kOverlapCouples);
    for (std::size_t k = 0; k < most; ++k) take(k * count / most);
  };
  some(pairs - 1, [&](std::size_t k) {
    out.emplace_back(static_cast<std::uint32_t>(k), static_cast<std::uint32_t>(k + 1));
  });
  if (slam != nullptr)
    some(slam->closures.size(), [&](std::size_t k) {
      if (slam->closures[k].kept) out.emplace_back(slam->closures[k].a, slam->closures[k].b);
    });
  return out;
}

class Comparer {
 public:
  explicit Comparer(Dive& dive)
      : dive_(dive),
        lighting_(dive.lighting()),
        planes_(dive.planes()),
        prepared_(dive.prepared()),
        poses_(dive.poses()),
        light_(dive.plan().light) {}

  ComparedCouple compare(std::uint32_t a, std::uint32_t b) const {
    ComparedCouple out;
    if (!poses_[a].T_nav_body || !poses_[b].T_nav_body || !prepared_.facts()[a].has_mesh ||
        !prepared_.facts()[b].has_mesh)
      return out;
    PairImages first(dive_.input(), lighting_), second(dive_.input(), lighting_);
    const std::vector<ImagePair>& pairs = dive_.survey().list.pairs;
    if (!first.readLeft(pairs[a]) || !second.readLeft(pairs[b])) return out;
    const Mesh seen = prepared_.mesh(a);
    const RgbImage one = first.colours(*planes_[a], seen.vertices, light_.gains[a], light_.water),
                   other =
                       second.colours(*planes_[b], prepared_.mesh(b).vertices, light_.gains[b], light_.water);
    const SE3& T_body_cam = dive_.input().mission.T_body_cam;
    const SE3 T_b_a = (*poses_[b].T_nav_body * T_body_cam).inverse() * (*poses_[a].T_nav_body * T_body_cam);
    const Camera& camera = dive_.input().rig.left;
    for (const Eigen::Vector3f& vertex : seen.vertices) {
      const Eigen::Vector3d p = vertex.cast<double>(), q = T_b_a * p;
      if (!(p.z() > 0) || !(q.z() > 0)) continue;
      const Eigen::Vector2d here = camera.project(p), there = camera.project(q);
      if (!inside(here, camera) || !inside(there, camera)) continue;
      out.before.push_back({colourAbout(first.asRead(), here), colourAbout(second.asRead(), there)});
      out.after.push_back({colourAbout(viewOf(one), here), colourAbout(viewOf(other), there)});
    }
    return out;
  }

 private:
  static bool inside(const Eigen::Vector2d& pixel, const Camera& camera) {
    return pixel.x() > kPlaceReach && pixel.y() > kPlaceReach && pixel.x() < camera.width - 1 - kPlaceReach &&
           pixel.y() < camera.height - 1 - kPlaceReach;
  }
  static ImageView viewOf(const RgbImage& image) {
    return {image.rgb.data(),  image.width,
            image.height,      3 * static_cast<std::size_t>(image.width),
            PixelFormat::kRgb, 8};
  }

  Dive& dive_;
  const LightingModels& lighting_;
  SeedPlanes planes_;
  const PreparedGroups& prepared_;
  const std::vector<NavigatedPose>& poses_;
  const GroundLight& light_;
};

}  // namespace

Eigen::Vector3d colourAbout(const ImageView& image, const Eigen::Vector2d& pixel) {
  const int x0 = static_cast<int>(std::lround(pixel.x())), y0 = static_cast<int>(std::lround(pixel.y()));
  const double full = (1 << image.bits) - 1;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero(), count = Eigen::Vector3d::Zero();
  for (int y = y0 - kPlaceReach; y <= y0 + kPlaceReach; ++y) {
    const auto* line =
        static_cast<const std::uint8_t*>(image.data) + static_cast<std::size_t>(y) * image.stride;
    const auto sample = [&](int at) {
      const auto k = static_cast<std::size_t>(at);
      return (image.bits == 8 ? line[k] : reinterpret_cast<const std::uint16_t*>(line)[k]) / full;
    };
    for (int x = x0 - kPlaceReach; x <= x0 + kPlaceReach; ++x) {
      if (image.format == PixelFormat::kRgb) {
        for (int c = 0; c < 3; ++c)
          sum(c) +=
              image.bits == 8 ? linearFromSrgb(line[static_cast<std::size_t>(3 * x + c)]) : sample(3 * x + c);
        count.array() += 1;
      } else {
        const int c = x % 2 + y % 2;  // red, green, green, blue
        sum(c) += sample(x);
        count(c) += 1;
      }
    }
  }
  return sum.cwiseQuotient(count);
}

OverlapColours::Difference differenceOf(const std::vector<PlaceColours>& places) {
  constexpr double kGrey = 0.2;  // a seafloor's mean albedo, where a* and b* are measured
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const PlaceColours& p : places) mean += 0.5 * (p.a + p.b) / static_cast<double>(places.size());
  const Eigen::Vector3d gain = kGrey * mean.cwiseMax(1e-6).cwiseInverse();
  const Eigen::Vector3d luminance(0.2126, 0.7152, 0.0722);
  std::vector<double> light, chroma;
  for (const PlaceColours& p : places) {
    const Eigen::Vector3d a = gain.cwiseProduct(p.a), b = gain.cwiseProduct(p.b);
    const double one = luminance.dot(a), other = luminance.dot(b);
    if (!(one + other > 0)) continue;
    light.push_back(2 * std::abs(one - other) / (one + other));
    chroma.push_back((labOf(a) - labOf(b)).tail<2>().norm());
  }
  return {median(light), median(chroma)};
}

OverlapColours overlapColours(Dive& dive) {
  OverlapColours out;
  const std::size_t pairs = dive.survey().list.pairs.size();
  if (dive.input().features_only || dive.input().mission.cameras.left_format == PixelFormat::kMono ||
      pairs < 2)
    return out;
  const auto couples = couplesOf(dive.localised(), pairs);
  const Comparer comparer(dive);
  std::vector<ComparedCouple> seen(couples.size());
  oneapi::tbb::parallel_for(std::size_t{0}, couples.size(), [&](std::size_t k) {
    seen[k] = comparer.compare(couples[k].first, couples[k].second);
  });
  std::vector<PlaceColours> before, after;
  for (const ComparedCouple& couple : seen) {
    out.couples += !couple.before.empty();
    before.insert(before.end(), couple.before.begin(), couple.before.end());
    after.insert(after.end(), couple.after.begin(), couple.after.end());
  }
  out.places = before.size();
  if (before.empty()) return out;
  out.before = differenceOf(before);
  out.after = differenceOf(after);
  return out;
}

namespace {

constexpr std::uint8_t kBackground = 255;
// Light from the north-west, 45 degrees up (the cartographers' convention), and how dark shade is.
const Eigen::Vector3f kToLight = Eigen::Vector3f(0.5F, -0.5F, -0.7071F);
constexpr float kAmbient = 0.35F;

}  // namespace

void MapExtent::add(const Mesh& part) {
  for (const auto& v : part.vertices) {
    low_ = low_.min(v.head<2>().cast<double>().array());
    high_ = high_.max(v.head<2>().cast<double>().array());
    ++depths_[v.z()];
  }
  vertices_ += part.vertices.size();
}

double MapExtent::depthAt(std::size_t percent) const {
  const std::size_t rank = (vertices_ - 1) * percent / 100;
  std::size_t below = 0;
  for (const auto& [depth, count] : depths_)
    if ((below += count) > rank) return static_cast<double>(depth);
  return 0;
}

MapPainter::MapPainter(const MapExtent& extent, int max_pixels, double min_metres) {
  if (extent.empty()) return;
  const Eigen::Array2d span = extent.high() - extent.low();
  picture_.shallowest = extent.depthAt(1);
  picture_.deepest = extent.depthAt(99);
  picture_.metres_per_pixel = std::max(min_metres, span.maxCoeff() / max_pixels);
  picture_.north = extent.high().x();
  picture_.west = extent.low().y();
  const auto pixels = [&](double metres) {
    return std::clamp(static_cast<int>(std::ceil(metres / picture_.metres_per_pixel)), 1, max_pixels);
  };
  picture_.width = pixels(span.y());
  picture_.height = pixels(span.x());
  seen_.resize(static_cast<std::size_t>(picture_.width) * static_cast<std::size_t>(picture_.height));
}

void MapPainter::add(const Mesh& part) {
  if (part.normals.size() != part.vertices.size()) {
    Mesh with_normals = part;
    computeNormals(with_normals);
    return add(with_normals);
  }
  for (const auto& t : part.triangles) {
    std::array<Eigen::Vector2d, 3> p;  // (row, column)
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3d v = part.vertices[t[k]].cast<double>();
      p[k] = {(picture_.north - v.x()) / picture_.metres_per_pixel - 0.5,
              (v.y() - picture_.west) / picture_.metres_per_pixel - 0.5};
    }
    scanTriangle(
        p, picture_.height, picture_.width, [&](int row, int column, const std::array<double, 3>& shares) {
          float depth = 0;
          Eigen::Vector3f normal = Eigen::Vector3f::Zero();
          std::array<float, 3> colour{};
          for (std::size_t k = 0; k < 3; ++k) {
            const auto w = static_cast<float>(shares[k]);
            depth += w * part.vertices[t[k]].z();
            normal += w * part.normals[t[k]];
            if (!part.colours.empty())
              for (std::size_t c = 0; c < 3; ++c) colour[c] += w * static_cast<float>(part.colours[t[k]][c]);
          }
          Seen& pixel = seen_[static_cast<std::size_t>(row) * static_cast<std::size_t>(picture_.width) +
                              static_cast<std::size_t>(column)];
          if (depth >= pixel.depth) return;
          const float lambert = std::max(0.0F, normal.normalized().dot(kToLight));
          pixel = {depth, kAmbient + (1 - kAmbient) * lambert / -kToLight.z(), colour};
        });
  }
}

MapPicture MapPainter::take() {
  cv::Mat scale(1, 256, CV_8UC1), colours;
  for (int k = 0; k < 256; ++k)
    scale.at<std::uint8_t>(0, k) = static_cast<std::uint8_t>(255 - k);  // deep is dark
  cv::applyColorMap(scale, colours, cv::COLORMAP_VIRIDIS);
  picture_.rgb.assign(seen_.size() * 3, kBackground);
  picture_.rgb_texture.assign(seen_.size() * 3, kBackground);
  const double span = std::max(picture_.deepest - picture_.shallowest, 1e-3);
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    if (!std::isfinite(seen_[k].depth)) continue;
    const double s = (static_cast<double>(seen_[k].depth) - picture_.shallowest) / span;
    const auto& bgr = colours.at<cv::Vec3b>(0, static_cast<int>(std::clamp(s, 0.0, 1.0) * 255));
    for (std::size_t c = 0; c < 3; ++c) {
      const auto shaded = [&](float value) {
        return static_cast<std::uint8_t>(std::min(255.0F, value * seen_[k].shade));
      };
      picture_.rgb[k * 3 + c] = shaded(static_cast<float>(bgr[static_cast<int>(2 - c)]));
      picture_.rgb_texture[k * 3 + c] = shaded(seen_[k].colour[c]);
    }
  }
  return std::move(picture_);
}

std::string toPng(const std::vector<std::uint8_t>& rgb, int width, int height) {
  cv::Mat bgr(height, width, CV_8UC3);
  for (std::size_t k = 0; k < rgb.size(); k += 3)
    bgr.at<cv::Vec3b>(static_cast<int>(k / 3) / width, static_cast<int>(k / 3) % width) = {
        rgb[k + 2], rgb[k + 1], rgb[k]};
  std::vector<std::uint8_t> bytes;
  if (rgb.empty() || !cv::imencode(".png", bgr, bytes))
    throw std::runtime_error("a picture cannot be encoded as PNG");
  return {bytes.begin(), bytes.end()};
}

}  // namespace fathom::topside
