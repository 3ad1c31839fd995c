#include "recon/topside/input/board_images.hpp"

#include <glob.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <optional>

#include "firmware_if/files/images/image_file.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/progress.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;

// Left and right of one moment, when each is stamped by its own camera's clock [ns].
constexpr std::int64_t kSameMoment = 100'000'000;

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

bool looksLikeImage(const fs::path& path) {
  static const std::array<std::string, 8> kExtensions{".tif",  ".tiff", ".png", ".jpg",
                                                      ".jpeg", ".bmp",  ".pgm", ".ppm"};
  const std::string extension = lower(path.extension().string());
  return std::find(kExtensions.begin(), kExtensions.end(), extension) != kExtensions.end();
}

void addFolder(const fs::path& folder, bool deeper, std::vector<fs::path>& out) {
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.is_regular_file() && looksLikeImage(entry.path())) out.push_back(entry.path());
    const std::string name = lower(entry.path().filename().string());
    if (deeper && entry.is_directory() && (name == "left" || name == "right"))
      addFolder(entry.path(), false, out);
  }
}

// Every image that was named, or lies in a folder that was named, by name.
std::vector<fs::path> listFiles(const std::vector<fs::path>& named) {
  std::vector<fs::path> out;
  for (const fs::path& path : named) {
    std::error_code error;
    if (fs::is_directory(path, error)) {
      addFolder(path, true, out);
    } else if (fs::is_regular_file(path, error)) {
      out.push_back(path);
    } else {
      throw InputError(path.string(), "", "is not there; name image files or a folder of them");
    }
  }
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

struct NamedSide {
  CameraSide side;
  std::string key;          // equal for left and right of one moment
  std::int64_t utc_ns = 0;  // ACFR names
};

// The side that a name tells: PR_..._LC16, "left" or "right" in the name, or the folder's name.
std::optional<NamedSide> sideOf(const fs::path& path) {
  if (const auto acfr = io::parseImageFileName(path.filename().string()))
    return NamedSide{acfr->side, "", acfr->utc_ns};
  const std::string stem = lower(path.stem().string());
  const std::string folder = lower(path.parent_path().filename().string());
  for (const auto& [word, side] :
       {std::pair("left", CameraSide::kLeft), std::pair("right", CameraSide::kRight)}) {
    const std::string text = word;
    if (const auto at = stem.find(text); at != std::string::npos)
      return NamedSide{side, std::string(stem).erase(at, text.size()), 0};
    if (folder == text) return NamedSide{side, "/" + stem, 0};
  }
  return std::nullopt;
}

std::vector<fs::path> matching(const std::string& pattern, const char* option) {
  ::glob_t found{};
  std::vector<fs::path> out;
  if (::glob(pattern.c_str(), 0, nullptr, &found) == 0)
    for (std::size_t k = 0; k < found.gl_pathc; ++k) out.emplace_back(found.gl_pathv[k]);
  ::globfree(&found);
  if (out.empty()) throw InputError(option, pattern, "matches no file; quote the pattern and check it");
  return out;
}

std::vector<BoardImagePair> pairPatterns(const BoardImageOptions& options) {
  if (options.left_pattern.empty() || options.right_pattern.empty())
    throw InputError(options.left_pattern.empty() ? "--left" : "--right", "",
                     "is missing; --left and --right go together");
  if (!options.images.empty())
    throw InputError("--left", "", "and --right stand instead of a list of images; give one or the other");
  const auto left = matching(options.left_pattern, "--left");
  const auto right = matching(options.right_pattern, "--right");
  if (left.size() != right.size())
    throw InputError("--right", options.right_pattern,
                     "matches " + std::to_string(right.size()) + " files where --left matches " +
                         std::to_string(left.size()) + "; each left image needs its right one");
  std::vector<BoardImagePair> pairs;
  for (std::size_t k = 0; k < left.size(); ++k)
    pairs.push_back({left[k].filename().string(), left[k], right[k]});
  return pairs;
}

// A Bayer mosaic is stored as grey: the option says what it is, or an ACFR name does.
io::ImageFile load(const fs::path& path, const std::string& format) {
  io::ImageFile image = io::readAnyImage(path);
  const bool mosaic = format == "bayer-rggb" || (format == "auto" && path.stem().string().ends_with("_LC16"));
  if (mosaic && image.view.format == PixelFormat::kMono) image.view.format = PixelFormat::kBayerRggb;
  return image;
}

// What one pair gave.
struct PairFinding {
  std::string trouble;  // empty: both boards found
  calibration::ImageSize left, right;
  calibration::Corners left_corners, right_corners;
};

PairFinding findPair(const BoardImagePair& pair, const BoardImageOptions& options,
                     const calibration::Chessboard& board) {
  PairFinding out;
  io::ImageFile left, right;
  try {
    left = load(pair.left, options.left_format);
    right = load(pair.right, options.right_format);
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

std::vector<BoardImagePair> listBoardImages(const BoardImageOptions& options,
                                            std::vector<calibration::DroppedView>& alone) {
  if (!options.left_pattern.empty() || !options.right_pattern.empty()) return pairPatterns(options);
  if (options.images.empty())
    throw InputError("IMAGES", "", "are missing; name image files, a folder of them, or --left and --right");
  struct TimedFile {
    std::int64_t utc_ns;
    fs::path path;
  };
  std::map<std::string, std::array<fs::path, 2>> by_key;
  std::array<std::vector<TimedFile>, 2> by_time;
  const std::vector<fs::path> files = listFiles(options.images);
  std::size_t unnamed = 0;
  for (const fs::path& file : files) {
    const auto named = sideOf(file);
    if (!named) {
      ++unnamed;
      continue;
    }
    const auto side = static_cast<std::size_t>(named->side);
    if (named->utc_ns != 0) {
      by_time[side].push_back({named->utc_ns, file});
    } else {
      by_key[named->key][side] = file;
    }
  }

  std::vector<BoardImagePair> pairs;
  const auto lonely = [&](const fs::path& file, const char* partner) {
    alone.push_back({file.filename().string(), std::string("no ") + partner + " image belongs to it"});
  };
  for (const auto& [key, two] : by_key) {
    if (two[1].empty())
      lonely(two[0], "right");
    else if (two[0].empty())
      lonely(two[1], "left");
    else
      pairs.push_back({two[0].filename().string(), two[0], two[1]});
  }
  std::vector<bool> taken(by_time[1].size(), false);
  for (const TimedFile& left : by_time[0]) {
    std::size_t best = by_time[1].size();
    std::int64_t nearest = kSameMoment;
    for (std::size_t k = 0; k < by_time[1].size(); ++k) {
      const std::int64_t apart = std::abs(by_time[1][k].utc_ns - left.utc_ns);
      if (!taken[k] && apart < nearest) nearest = apart, best = k;
    }
    if (best == by_time[1].size()) {
      lonely(left.path, "right");
      continue;
    }
    taken[best] = true;
    pairs.push_back({left.path.filename().string(), left.path, by_time[1][best].path});
  }
  for (std::size_t k = 0; k < taken.size(); ++k)
    if (!taken[k]) lonely(by_time[1][k].path, "left");

  if (pairs.empty()) {
    std::string why = "no pair of a left and a right image among " + std::to_string(files.size()) + " images";
    why += unnamed == files.size()
               ? "; name them left01 and right01, or *_LC16 and *_RM16, or give --left and --right"
               : "; " + alone[0].name + ": " + alone[0].reason;
    throw InputError(options.images[0].string(), "", why);
  }
  return pairs;
}

BoardImages findBoards(const BoardImageOptions& options, const calibration::Chessboard& board) {
  BoardImages out;
  const std::vector<BoardImagePair> pairs = listBoardImages(options, out.dropped);
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
      out.views.push_back(
          {pairs[k].name, std::move(found[k].left_corners), std::move(found[k].right_corners)});
    else
      out.dropped.push_back({pairs[k].name, found[k].trouble});
  }
  if (out.views.empty())
    throw InputError(pairs[0].left.parent_path().string(), "",
                     "no pair shows the whole board; the first, " + pairs[0].name + ": " + found[0].trouble);
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
