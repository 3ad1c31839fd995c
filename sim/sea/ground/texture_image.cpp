#include "sim/sea/ground/texture_image.hpp"

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

constexpr int kLevels = 5;  // a footprint of 16 texels; beyond that surveys do not fly

std::array<float, 256> makeSrgbTable() {
  std::array<float, 256> table{};
  for (int i = 0; i < 256; ++i) {
    const double v = i / 255.0;
    table[static_cast<std::size_t>(i)] =
        static_cast<float>(v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4));
  }
  return table;
}

const std::array<float, 256> kLinear = makeSrgbTable();

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
  // So smooth a light needs few pixels.
  constexpr int kColumns = 128;
  cv::Mat light, gray;
  cv::cvtColor(linear, gray, cv::COLOR_RGB2GRAY);
  cv::resize(gray, light, {kColumns, std::max(1, kColumns * image.rows / image.cols)}, 0, 0, cv::INTER_AREA);
  cv::GaussianBlur(light, light, {}, kLightSize * kColumns);
  cv::resize(light, light, gray.size(), 0, 0, cv::INTER_LINEAR);
  const double mean = cv::mean(gray)[0];
  std::vector<std::uint8_t> rgb(3 * image.total());
  for (std::size_t k = 0; k < rgb.size(); ++k)
    rgb[k] = srgbFromLinear(static_cast<double>(linear.ptr<float>()[k]) * mean /
                            static_cast<double>(light.ptr<float>()[k / 3]));
  return {image.cols, image.rows, rgb};
}

}  // namespace

float linearFromSrgb(std::uint8_t value) {
  return kLinear[value];
}

std::uint8_t srgbFromLinear(double value) {
  const double v = std::clamp(value, 0.0, 1.0);
  const double s = v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1.0 / 2.4) - 0.055;
  return static_cast<std::uint8_t>(std::lround(255.0 * s));
}

Rgb srgbFromLinear(const Eigen::Vector3d& linear) {
  return {srgbFromLinear(linear.x()), srgbFromLinear(linear.y()), srgbFromLinear(linear.z())};
}

TextureImage::TextureImage(const std::filesystem::path& path) {
  cv::Mat image;
  try {
    image = cv::imread(path, cv::IMREAD_COLOR);
  } catch (const cv::Exception&) {
    image.release();
  }
  if (image.empty())
    throw InputError(path, "", "cannot be read as an image; give a JPEG, PNG or TIFF texture");
  cv::cvtColor(image, image, cv::COLOR_BGR2RGB);
  if (image.cols < 2 || image.rows < 2)
    throw InputError(path, "", "is smaller than 2 x 2 pixels; give a texture image");
  *this = TextureImage(image.cols, image.rows, {image.datastart, image.dataend});
}

TextureImage::TextureImage(int width, int height, const std::vector<std::uint8_t>& rgb) {
  levels_.push_back({width, height, rgb});
  for (int i = 1; i < kLevels && levels_.back().width >= 4 && levels_.back().height >= 4; ++i) {
    Level& whole = levels_.back();
    Level level{whole.width / 2, whole.height / 2, {}};
    level.rgb.resize(3 * static_cast<std::size_t>(level.width) * static_cast<std::size_t>(level.height));
    cv::Mat half(level.height, level.width, CV_8UC3, level.rgb.data());
    cv::resize(cv::Mat(whole.height, whole.width, CV_8UC3, whole.rgb.data()), half, half.size(), 0, 0,
               cv::INTER_AREA);
    levels_.push_back(std::move(level));
  }
}

std::array<float, 3> TextureImage::sample(const Eigen::Vector2f& st, float texels) const {
  std::size_t index = 0;
  while (index + 1 < levels_.size() && texels > 1.5F) {
    texels *= 0.5F;
    ++index;
  }
  const Level& level = levels_[index];
  const float x =
      std::clamp(st.x() * static_cast<float>(level.width) - 0.5F, 0.0F, static_cast<float>(level.width - 1));
  const float y = std::clamp((1.0F - st.y()) * static_cast<float>(level.height) - 0.5F, 0.0F,
                             static_cast<float>(level.height - 1));
  const int x0 = std::min(static_cast<int>(x), level.width - 2),
            y0 = std::min(static_cast<int>(y), level.height - 2);
  const float u = x - static_cast<float>(x0), v = y - static_cast<float>(y0);
  const std::uint8_t* top =
      &level.rgb[3 * (static_cast<std::size_t>(y0) * static_cast<std::size_t>(level.width) +
                      static_cast<std::size_t>(x0))];
  const std::uint8_t* bottom = top + 3 * static_cast<std::size_t>(level.width);
  std::array<float, 3> colour{};
  for (std::size_t c = 0; c < 3; ++c) {
    const float a = kLinear[top[c]] * (1 - u) + kLinear[top[c + 3]] * u;
    const float b = kLinear[bottom[c]] * (1 - u) + kLinear[bottom[c + 3]] * u;
    colour[c] = a * (1 - v) + b * v;
  }
  return colour;
}

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
