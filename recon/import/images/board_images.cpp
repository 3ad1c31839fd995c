#include "recon/import/images/board_images.hpp"

#include <oneapi/tbb/parallel_for.h>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "realtime/base/input_error.hpp"
#include "realtime/base/progress.hpp"
#include "recon/import/images/image_samples.hpp"
#include "recon/lighting/demosaic.hpp"
#include "recon/lighting/lighting_model.hpp"

namespace fathom::topside {
ImageView LooseImage::monoView() const {
  return {mono.data(), width, height, static_cast<std::size_t>(width), PixelFormat::kMono, 8};
}

ImageView LooseImage::rgbView() const {
  return {rgb.data(), width, height, static_cast<std::size_t>(width) * 3, PixelFormat::kRgb, 8};
}

LooseImage readLooseImage(const std::filesystem::path& path, Samples samples, const Camera& camera) {
  const io::ImageFile file = readSamples(path, samples);
  requireSize(file, camera, path);
  LooseImage image{file.view.width, file.view.height, file.view.format, file.view.bits, {}, {}};
  const std::size_t pixels = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
  image.mono.resize(pixels);
  image.rgb.resize(pixels * 3);
  if (file.view.bits == 8) {
    lighting::greyOf(file.view, lighting::usualShares(image.format), image.rgb.data(), image.mono.data());
  } else {
    // The whole image's mean and spread, as a mission's model has them before it has seen several images.
    lighting::LightingModel model(image.width, image.height, image.format, file.view.bits, {});
    model.add(file.view);
    std::vector<std::uint8_t> mosaic(pixels * samplesPerPixel(image.format));
    model.grey(file.view, {}, mosaic.data(), image.rgb.data(), image.mono.data());
  }
  if (image.format == PixelFormat::kMono) lighting::demosaicRgb(image.monoView(), image.rgb.data());
  return image;
}

namespace {

namespace fs = std::filesystem;

// What one pair gave.
struct PairFinding {
  std::string trouble;  // empty: both boards found
  calibration::ImageSize left, right;
  calibration::Corners left_corners, right_corners;
};

PairFinding findPair(const StereoFilePair& pair, const BoardImageOptions& options,
                     const calibration::Chessboard& board) {
  PairFinding out;
  io::ImageFile left, right;
  try {
    left = readSamples(pair.left, samplesNamed(options.left_format));
    right = readSamples(pair.right, samplesNamed(options.right_format));
  } catch (const InputError& error) {
    out.trouble = error.what();
    return out;
  }
  out.left = {left.view.width, left.view.height};
  out.right = {right.view.width, right.view.height};
  auto in_left = calibration::findChessboard(left.view, board);
  auto in_right = calibration::findChessboard(right.view, board);
  if (!in_left || !in_right) {
    const std::string where = in_left ? "the right image" : in_right ? "the left image" : "either image";
    out.trouble = "no whole board of " + std::to_string(board.columns) + " x " + std::to_string(board.rows) +
                  " inner corners in " + where;
    return out;
  }
  out.left_corners = std::move(*in_left);
  out.right_corners = std::move(*in_right);
  return out;
}

void requireSameSize(calibration::ImageSize& known, const calibration::ImageSize& one, const fs::path& file,
                     fs::path& first) {
  if (known.width == 0) {
    known = one;
    first = file;
  }
  if (one.width == known.width && one.height == known.height) return;
  throw InputError(file.string(), "",
                   "is " + std::to_string(one.width) + " x " + std::to_string(one.height) + " where " +
                       first.filename().string() + " is " + std::to_string(known.width) + " x " +
                       std::to_string(known.height) + "; one camera gives one size");
}

}  // namespace

BoardImages findBoards(const BoardImageOptions& options, const calibration::Chessboard& board) {
  BoardImages out;
  const StereoFiles files = findStereoFiles(options);
  for (const StereoFiles::Alone& a : files.alone)
    out.dropped.push_back({a.file.filename().string(), "no " + a.missing + " image belongs to it"});
  const std::vector<StereoFilePair>& pairs = files.pairs;
  std::vector<PairFinding> found(pairs.size());
  {
    rt::StageProgress progress("boards", pairs.size());
    oneapi::tbb::parallel_for(std::size_t{0}, pairs.size(), [&](std::size_t k) {
      found[k] = findPair(pairs[k], options, board);
      progress.step();
    });
  }
  fs::path first_left, first_right;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (found[k].left.width > 0) {
      requireSameSize(out.left, found[k].left, pairs[k].left, first_left);
      requireSameSize(out.right, found[k].right, pairs[k].right, first_right);
    }
    if (found[k].trouble.empty())
      out.views.push_back({pairs[k].left.filename().string(), std::move(found[k].left_corners),
                           std::move(found[k].right_corners)});
    else
      out.dropped.push_back({pairs[k].left.filename().string(), found[k].trouble});
  }
  if (out.views.empty())
    throw InputError(pairs[0].left.parent_path().string(), "",
                     "no pair shows the whole board; the first, " + pairs[0].left.filename().string() + ": " +
                         found[0].trouble);
  return out;
}

calibration::Chessboard parseBoard(const std::string& size, double square_m) {
  calibration::Chessboard board;
  int used = 0;
  constexpr int kLeast = 3, kMost = 100;  // inner corners along a side
  if (std::sscanf(size.c_str(), "%3dx%3d%n", &board.columns, &board.rows, &used) != 2 ||
      static_cast<std::size_t>(used) != size.size() || std::min(board.columns, board.rows) < kLeast ||
      std::max(board.columns, board.rows) > kMost)
    throw InputError("--board", size,
                     "is not COLUMNSxROWS of inner corners, from 3 to 100 each, such as 9x6");
  if (!(std::isfinite(square_m) && square_m > 0))
    throw InputError("--square", std::to_string(square_m),
                     "is no length; give the edge of a square in metres");
  board.square = square_m;
  return board;
}

}  // namespace fathom::topside
