#include "sim/sea/ground/albedo_images.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "realtime/base/input_error.hpp"
#include "sim/sea/ground/noise.hpp"

namespace fathom::sim {
namespace {

constexpr float kEdge = 0.5F;       // of the lattice's triangles, and radius of a piece about its node [m]
constexpr double kLightSize = 0.2;  // over the image's width: coarser variation is uneven illumination

// Reads a photograph and removes its uneven illumination.
TextureImage flattened(const std::filesystem::path& path) {
  cv::Mat image;
  try {
    image = cv::imread(path, cv::IMREAD_COLOR);
  } catch (const cv::Exception&) {
    image.release();
  }
  if (image.empty()) throw InputError(path, "", "cannot be read as an image; keep photographs alone here");
  cv::cvtColor(image, image, cv::COLOR_BGR2RGB);
  cv::Mat linear(image.size(), CV_32FC3);
  std::transform(image.datastart, image.dataend, linear.ptr<float>(), linearFromSrgb);
  cv::Mat light, gray;
  cv::cvtColor(linear, gray, cv::COLOR_RGB2GRAY);
  cv::GaussianBlur(gray, light, {}, kLightSize * image.cols);
  const double mean = cv::mean(gray)[0];
  std::vector<std::uint8_t> rgb(3 * image.total());
  for (std::size_t k = 0; k < rgb.size(); ++k)
    rgb[k] = srgbFromLinear(static_cast<double>(linear.ptr<float>()[k]) * mean /
                            static_cast<double>(light.ptr<float>()[k / 3]));
  return {image.cols, image.rows, rgb};
}

}  // namespace

AlbedoImages::AlbedoImages(const std::filesystem::path& folder, double pixel_m, double contrast,
                           std::uint64_t seed)
    : pixel_m_(static_cast<float>(pixel_m)), contrast_(static_cast<float>(contrast)), seed_(seed) {
  std::error_code error;
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  for (const std::filesystem::path& file : files) {
    images_.push_back(flattened(file));
    const TextureImage& image = images_.back();
    if (static_cast<float>(std::min(image.width(), image.height())) * pixel_m_ < 2 * kEdge)
      throw InputError(file, "", "shows less than a metre of ground; give larger images or albedo_pixel_m");
    const std::array<float, 3> whole = image.sample({0.5F, 0.5F}, 1e9F);
    for (std::size_t c = 0; c < 3; ++c) mean_[c] += whole[c];
  }
  if (images_.empty()) throw InputError(folder, "", "holds no images; name a folder of photographs");
  for (float& m : mean_) m /= static_cast<float>(images_.size());
}

std::array<float, 3> AlbedoImages::piece(const Eigen::Vector2i& node, const Eigen::Vector2f& from_node,
                                         float texels) const {
  GroundRandom random(seed_, (static_cast<std::uint64_t>(static_cast<std::uint32_t>(node.x())) << 32) |
                                 static_cast<std::uint32_t>(node.y()));
  const TextureImage& image = images_[random.bits() % images_.size()];
  const auto turn = static_cast<float>(random.uniform(0, 2 * std::numbers::pi));
  const float mirror = random.uniform() < 0.5 ? -1.0F : 1.0F;
  const float reach = kEdge / pixel_m_;
  const auto width = static_cast<float>(image.width()), height = static_cast<float>(image.height());
  const Eigen::Vector2f centre(static_cast<float>(random.uniform(reach, width - reach)),
                               static_cast<float>(random.uniform(reach, height - reach)));
  const Eigen::Vector2f turned = Eigen::Rotation2Df(turn) * from_node / pixel_m_;
  const Eigen::Vector2f pixel = centre + Eigen::Vector2f(mirror * turned.x(), turned.y());
  return image.sample({pixel.x() / width, 1 - pixel.y() / height}, texels);
}

std::array<float, 3> AlbedoImages::at(const Eigen::Vector3f& place, const Eigen::Vector3f& normal,
                                      float footprint_m) const {
  // Least normal component along an axis for projection from there; one of the three is always larger.
  constexpr float kLeast = 0.55F;
  const Eigen::Vector3f weights = (normal.cwiseAbs().array() - kLeast).max(0.0F);
  constexpr float kApart = 97;  // offset of the side projections, so that they show other parts [m]
  const std::array<Eigen::Vector2f, 3> planes{Eigen::Vector2f(place.y() + 2 * kApart, place.z()),
                                              Eigen::Vector2f(place.x() + kApart, place.z()),
                                              place.head<2>()};
  std::array<float, 3> sum{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const float weight = weights[static_cast<Eigen::Index>(axis)];
    if (weight == 0) continue;
    const auto seen = inPlane(planes[axis], footprint_m);
    if (weight == weights.sum()) return seen;
    for (std::size_t c = 0; c < 3; ++c) sum[c] += weight * (seen[c] - mean_[c]);
  }
  std::array<float, 3> out{};
  for (std::size_t c = 0; c < 3; ++c) out[c] = std::clamp(mean_[c] + sum[c] / weights.norm(), 0.01F, 1.0F);
  return out;
}

std::array<float, 3> AlbedoImages::inPlane(const Eigen::Vector2f& place, float footprint_m) const {
  // Coordinates in a lattice where each triangle is half of a unit square.
  constexpr float kSlant = 0.57735027F;  // 1 / sqrt 3
  const Eigen::Vector2f p(place.x() / kEdge - kSlant * place.y() / kEdge, 2 * kSlant * place.y() / kEdge);
  const Eigen::Vector2i corner(static_cast<int>(std::floor(p.x())), static_cast<int>(std::floor(p.y())));
  const Eigen::Vector2f in = p - corner.cast<float>();
  const bool upper = in.x() + in.y() > 1;
  const Eigen::Vector2i nodes[3] = {upper ? corner + Eigen::Vector2i(1, 1) : corner,
                                    corner + Eigen::Vector2i(1, 0), corner + Eigen::Vector2i(0, 1)};
  float weights[3] = {upper ? in.x() + in.y() - 1 : 1 - in.x() - in.y(), upper ? 1 - in.y() : in.x(),
                      upper ? 1 - in.x() : in.y()};
  float total = 0, squares = 0;
  for (float& w : weights) total += w = w * w * w;
  for (float& w : weights) w /= total, squares += w * w;
  std::array<float, 3> sum{};
  for (int k = 0; k < 3; ++k) {
    if (weights[k] < 1e-3F) continue;
    const Eigen::Vector2f node(
        kEdge * (static_cast<float>(nodes[k].x()) + 0.5F * static_cast<float>(nodes[k].y())),
        kEdge * 0.8660254F * static_cast<float>(nodes[k].y()));
    const auto seen = piece(nodes[k], place - node, footprint_m / pixel_m_);
    for (std::size_t c = 0; c < 3; ++c) sum[c] += weights[k] * (seen[c] - mean_[c]);
  }
  std::array<float, 3> out{};
  for (std::size_t c = 0; c < 3; ++c)
    out[c] = std::clamp(mean_[c] + contrast_ * sum[c] / std::sqrt(squares), 0.01F, 1.0F);
  return out;
}

}  // namespace fathom::sim
