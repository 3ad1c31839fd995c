#include "tests/bench/accuracy/texture_error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "tests/bench/common/measures.hpp"

namespace fathom::accuracy {
namespace {

constexpr std::array<int, 3> kWindows = {384, 192, 96};  // edges, of which the largest that fits [texels]
constexpr double kLeastKnown = 0.8;                      // of a window's pixels

struct Pair {
  ViewFromAbove model, truth, truth_in_place;
  double shift = 0;  // [m]
};

// 1 where both show something.
cv::Mat bothKnown(const ViewFromAbove& a, const ViewFromAbove& b) {
  cv::Mat mask(a.depth.size(), CV_8U);
  for (int y = 0; y < mask.rows; ++y)
    for (int x = 0; x < mask.cols; ++x)
      mask.at<std::uint8_t>(y, x) =
          std::isfinite(a.depth.at<float>(y, x)) && std::isfinite(b.depth.at<float>(y, x)) ? 255 : 0;
  return mask;
}

cv::Mat brightness(const cv::Mat& rgb) {
  cv::Mat out;
  cv::transform(rgb, out, cv::Matx13f(1.0F / 3, 1.0F / 3, 1.0F / 3));
  return out;
}

// Where a window lies in its tile, in windows from the middle of its surface; the middle first.
constexpr std::array<std::array<int, 2>, 9> kPlaces = {
    {{0, 0}, {1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {1, -1}, {-1, 1}, {-1, -1}}};

// Nothing where too little is known.
std::optional<Pair> windowOf(const TexturedTile& tile, const sim::Appearance& truth, const SE3& T_truth_model,
                             int edge, const std::array<int, 2>& place) {
  const Mesh& mesh = tile.surface.mesh;
  Eigen::Vector2f low = mesh.vertices.at(0).head<2>(), high = low;
  for (const auto& v : mesh.vertices) {
    low = low.cwiseMin(v.head<2>());
    high = high.cwiseMax(v.head<2>());
  }
  const Eigen::Vector2d middle = 0.5 * (low + high).cast<double>();
  Canvas canvas;
  canvas.pixel = tile.texel;
  canvas.columns = canvas.rows = edge;
  const double half = 0.5 * edge * canvas.pixel;
  canvas.north = middle.x() + (1 + 2 * place[0]) * half;
  canvas.west = middle.y() + (2 * place[1] - 1) * half;
  ViewFromAbove model(canvas);
  drawTile(tile, model);
  cv::Mat known;
  cv::compare(model.depth, 1e30, known, cv::CMP_LT);
  if (cv::countNonZero(known) < kLeastKnown * edge * edge) return std::nullopt;
  ViewFromAbove in_place = drawTruth(truth, model, T_truth_model, {0, 0});
  const cv::Mat mask = bothKnown(model, in_place);
  if (cv::countNonZero(mask) < kLeastKnown * edge * edge) return std::nullopt;
  cv::Mat a = brightness(model.colour), b = brightness(in_place.colour);
  a -= cv::mean(a, mask);
  b -= cv::mean(b, mask);
  a.setTo(0, ~mask);
  b.setTo(0, ~mask);
  cv::Mat taper;
  cv::createHanningWindow(taper, a.size(), CV_32F);
  const cv::Point2d found = cv::phaseCorrelate(a, b, taper);
  // Columns to the east, rows to the south; a shift of the truth's place is one of its picture back.
  const Eigen::Vector2d shift(-found.y * canvas.pixel, found.x * canvas.pixel);
  ViewFromAbove shifted = drawTruth(truth, model, T_truth_model, shift);
  return Pair{std::move(model), std::move(shifted), std::move(in_place), shift.norm()};
}

// The windows of a tile: all of the largest size that fits, or the first of them.
std::vector<Pair> windowsOf(const TexturedTile& tile, const sim::Appearance& truth, const SE3& T_truth_model,
                            bool all) {
  std::vector<Pair> windows;
  for (const int edge : kWindows) {
    for (const auto& place : kPlaces) {
      auto window = windowOf(tile, truth, T_truth_model, edge, place);
      if (!window) continue;
      windows.push_back(std::move(*window));
      if (!all) return windows;
    }
    if (!windows.empty()) break;
  }
  return windows;
}

// Least squares gain and offset that take the truth to the model.
struct Line {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  void add(double truth, double model) {
    n += 1, x += truth, y += model, xx += truth * truth, xy += truth * model, yy += model * model;
  }
  [[nodiscard]] double gain() const {
    const double spread = n * xx - x * x;
    return spread > 0 ? (n * xy - x * y) / spread : 0;
  }
  [[nodiscard]] double offset() const { return n > 0 ? (y - gain() * x) / n : 0; }
  [[nodiscard]] double correlation() const {
    const double spread = (n * xx - x * x) * (n * yy - y * y);
    return spread > 0 ? (n * xy - x * y) / std::sqrt(spread) : 0;
  }
};
using Lines = std::array<Line, 3>;

void addTo(Lines& lines, const ViewFromAbove& model, const ViewFromAbove& truth) {
  const cv::Mat mask = bothKnown(model, truth);
  for (int y = 0; y < mask.rows; ++y)
    for (int x = 0; x < mask.cols; ++x)
      if (mask.at<std::uint8_t>(y, x) != 0)
        for (int c = 0; c < 3; ++c)
          lines[static_cast<std::size_t>(c)].add(static_cast<double>(truth.colour.at<cv::Vec3f>(y, x)[c]),
                                                 static_cast<double>(model.colour.at<cv::Vec3f>(y, x)[c]));
}

// The truth as the model would show it, in 8 bits' range.
cv::Mat lit(const cv::Mat& truth, const Lines& lines) {
  std::vector<cv::Mat> channels;
  cv::split(truth, channels);
  for (std::size_t c = 0; c < 3; ++c)
    channels[c] = cv::min(cv::max(channels[c] * lines[c].gain() + lines[c].offset(), 0.0), 255.0);
  cv::Mat out;
  cv::merge(channels, out);
  return out;
}

// Wang et al. 2004, equation 13, with their window (Gaussian, 1.5 px) and constants; the mean over the mask.
double ssim(const cv::Mat& a, const cv::Mat& b, const cv::Mat& mask) {
  const auto blur = [](const cv::Mat& m) {
    cv::Mat out;
    cv::GaussianBlur(m, out, {11, 11}, 1.5);
    return out;
  };
  constexpr double kFirst = 0.01 * 255 * 0.01 * 255, kSecond = 0.03 * 255 * 0.03 * 255;
  const cv::Mat ma = blur(a), mb = blur(b);
  const cv::Mat aa = blur(a.mul(a)) - ma.mul(ma), bb = blur(b.mul(b)) - mb.mul(mb),
                ab = blur(a.mul(b)) - ma.mul(mb);
  const cv::Mat over = (2 * ma.mul(mb) + kFirst).mul(2 * ab + kSecond);
  const cv::Mat under = (ma.mul(ma) + mb.mul(mb) + kFirst).mul(aa + bb + kSecond);
  cv::Mat ratio;
  cv::divide(over, under, ratio);
  return cv::mean(ratio, mask)[0];
}

double gradientEnergy(const cv::Mat& image, const cv::Mat& mask) {
  cv::Mat x, y;
  cv::Sobel(image, x, CV_32F, 1, 0);
  cv::Sobel(image, y, CV_32F, 0, 1);
  return cv::mean(x.mul(x) + y.mul(y), mask)[0];
}

// Away from the border of what is known by the filters' reach.
cv::Mat inner(const cv::Mat& mask) {
  cv::Mat out;
  cv::erode(mask, out, cv::Mat::ones(11, 11, CV_8U), {-1, -1}, 1, cv::BORDER_CONSTANT, cv::Scalar(0));
  return out;
}

struct Sums {
  double squares = 0, samples = 0, ssim = 0, windows = 0, model_energy = 0, truth_energy = 0;
  void add(const ViewFromAbove& model, const ViewFromAbove& truth, const Lines& lines) {
    const cv::Mat mask = bothKnown(model, truth), expected = lit(truth.colour, lines);
    squares += std::pow(cv::norm(model.colour, expected, cv::NORM_L2, mask), 2);
    samples += 3.0 * cv::countNonZero(mask);
    const cv::Mat core = inner(mask);
    const cv::Mat a = brightness(model.colour), b = brightness(expected);
    ssim += fathom::accuracy::ssim(a, b, core);
    model_energy += gradientEnergy(a, core);
    truth_energy += gradientEnergy(b, core);
    windows += 1;
  }
  [[nodiscard]] double psnr() const {
    return 10 * std::log10(255.0 * 255.0 * samples / std::max(squares, 1e-9));
  }
};

cv::Mat eightBits(const cv::Mat& rgb) {
  cv::Mat out;
  rgb.convertTo(out, CV_8UC3);
  cv::cvtColor(out, out, cv::COLOR_RGB2BGR);
  return out;
}

// Model, truth in the model's light, and four times their difference about grey.
void writeTriple(const ViewFromAbove& model, const ViewFromAbove& truth, const std::filesystem::path& png) {
  Lines lines;
  addTo(lines, model, truth);
  const cv::Mat mask = bothKnown(model, truth), expected = lit(truth.colour, lines);
  cv::Mat difference = (model.colour - expected) * 4 + cv::Scalar::all(128);
  cv::Mat a = eightBits(model.colour), b = eightBits(expected), c = eightBits(difference);
  for (cv::Mat* picture : {&a, &b, &c}) picture->setTo(cv::Scalar::all(255), ~mask);
  cv::Mat beside;
  const cv::Mat gap(a.rows, 8, CV_8UC3, cv::Scalar::all(255));
  cv::hconcat(std::vector<cv::Mat>{a, gap, b, gap, c}, beside);
  cv::imwrite(png.string(), beside);
}

}  // namespace

TextureError textureErrorOf(const ModelTiles& tiles, int level, const sim::Appearance& truth,
                            const SE3& T_truth_model, std::size_t most) {
  TextureError out;
  const auto& files = tiles.filesOf(level);
  const std::size_t step = std::max<std::size_t>(1, (files.size() + most - 1) / most);
  std::vector<Pair> windows;
  std::vector<double> shifts;
  for (std::size_t i = 0; i < files.size(); i += step) {
    const TexturedTile tile = ModelTiles::read(files[i]);
    if (tile.atlas.empty()) continue;
    for (Pair& window : windowsOf(tile, truth, T_truth_model, files.size() * kPlaces.size() <= most)) {
      out.pixel = tile.texel;
      shifts.push_back(window.shift);
      windows.push_back(std::move(window));
    }
  }
  out.windows = windows.size();
  if (windows.empty()) return out;
  Lines lines;
  for (const Pair& w : windows) addTo(lines, w.model, w.truth);
  Sums sums, in_place;
  for (const Pair& w : windows) {
    sums.add(w.model, w.truth, lines);
    in_place.add(w.model, w.truth_in_place, lines);
  }
  out.pixels = static_cast<std::size_t>(sums.samples / 3);
  out.shift_p50 = bench::quantile(shifts, 0.5);
  out.shift_p95 = bench::quantile(shifts, 0.95);
  out.psnr = sums.psnr();
  out.ssim = sums.ssim / sums.windows;
  out.psnr_in_place = in_place.psnr();
  out.ssim_in_place = in_place.ssim / in_place.windows;
  out.correlation = (lines[0].correlation() + lines[1].correlation() + lines[2].correlation()) / 3;
  out.detail = sums.truth_energy > 0 ? sums.model_energy / sums.truth_energy : 0;
  return out;
}

void drawBesideTruth(const ModelTiles& tiles, const sim::Appearance& truth, const SE3& T_truth_model,
                     int longest, const std::filesystem::path& png) {
  // The extent, from the coarsest level; then the coarsest level that is fine enough.
  const std::vector<int> levels = tiles.levels();
  const Mesh coarse = tiles.surfaceOf(levels.back());
  Eigen::Vector2f low = coarse.vertices.at(0).head<2>(), high = low;
  for (const auto& v : coarse.vertices) {
    low = low.cwiseMin(v.head<2>());
    high = high.cwiseMax(v.head<2>());
  }
  Canvas canvas;
  canvas.pixel = std::max(static_cast<double>((high - low).maxCoeff()) / longest, 1e-4);
  canvas.north = static_cast<double>(high.x());
  canvas.west = static_cast<double>(low.y());
  canvas.columns = std::max(1, static_cast<int>(static_cast<double>(high.y() - low.y()) / canvas.pixel));
  canvas.rows = std::max(1, static_cast<int>(static_cast<double>(high.x() - low.x()) / canvas.pixel));
  int level = levels.front();
  for (const int l : levels)
    if (ModelTiles::read(tiles.filesOf(l).front()).texel <= canvas.pixel) level = l;
  ViewFromAbove model(canvas);
  for (const auto& file : tiles.filesOf(level)) drawTile(ModelTiles::read(file), model);
  writeTriple(model, drawTruth(truth, model, T_truth_model, {0, 0}), png);
}

void drawWindowBesideTruth(const ModelTiles& tiles, int level, const sim::Appearance& truth,
                           const SE3& T_truth_model, const std::filesystem::path& png) {
  const auto& files = tiles.filesOf(level);
  for (std::size_t k = 0; k < files.size(); ++k) {
    const TexturedTile tile = ModelTiles::read(files[(files.size() / 2 + k) % files.size()]);
    if (tile.atlas.empty()) continue;
    const std::vector<Pair> windows = windowsOf(tile, truth, T_truth_model, false);
    if (windows.empty()) continue;
    writeTriple(windows.front().model, windows.front().truth, png);
    return;
  }
}

}  // namespace fathom::accuracy
