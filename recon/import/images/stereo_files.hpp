#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace fathom::topside {

// Where the image files of a stereo rig are, and how their names are to be read.
struct StereoFileOptions {
  std::vector<std::filesystem::path> images = {};  // files and folders; left and right distinguished by name
  std::string left_pattern = {}, right_pattern = {};  // or two shell patterns
  std::filesystem::path pairs = {};  // or a CSV file with columns left, right and, if known, utc
  std::string time_pattern = {};     // of NameTime; none: the usual ones
  double tolerance = 0.05;           // left and right of one pair by time [s]
};

struct StereoFilePair {
  std::filesystem::path left, right;
  std::optional<std::int64_t> utc_ns;  // of the left exposure
};

struct StereoFiles {
  // By time, or, where that is not known of any, in order of name.
  std::vector<StereoFilePair> pairs;
  struct Alone {
    std::filesystem::path file;
    std::string missing;  // "left" or "right"
  };
  std::vector<Alone> alone;
  std::vector<std::string> assumed;  // by what sides and times were found, a line each
};

// Left and right are distinguished by the words that most pairs are made of, in folders' or files' names
// (left and right, port and starboard, l and r, cam0 and cam1, image_2 and image_3 and the like; ..._LC16 and
// ..._RM16), with the rest of the name equal. Where two folders hold other names each, images are paired by
// the times in the names, no more than `tolerance` apart, or, where there are as many on both sides, in
// order. Two patterns pair names whose wildcards stand for the same, else for the same numbers, else as two
// folders. What has no partner, or as one of few no time, is named in `assumed`. Throws InputError when there
// is no pair, and for files that are absent.
[[nodiscard]] StereoFiles findStereoFiles(const StereoFileOptions& options);

// Each with the other file of the same name, else of the same numbers in it, else, of those left over, of the
// same time or, where there are as many, place in order.
[[nodiscard]] std::vector<StereoFilePair> partnersByName(const std::vector<std::filesystem::path>& left,
                                                         const std::vector<std::filesystem::path>& others,
                                                         double tolerance);

// Those that a shell pattern matches, 2.png before 10.png. Throws InputError, which names `option`, for none.
[[nodiscard]] std::vector<std::filesystem::path> filesMatching(const std::string& pattern,
                                                               const char* option);

// Where a path says that a file is; what links lead to may be anywhere.
[[nodiscard]] inline std::filesystem::path asNamed(const std::filesystem::path& file) {
  return std::filesystem::absolute(file).lexically_normal();
}

// The pictures in a folder and a few levels below it, by their endings, in order of name.
[[nodiscard]] std::vector<std::filesystem::path> picturesIn(const std::filesystem::path& folder);

// The nearest right image of each left one, each used once: by their times, ascending [ns], about a skew that
// follows the pairs found, because the cameras' clocks drift apart. None: no right image within `tolerance`
// [s], which is wider by what clocks drift apart since the last pair or, before the first, since `start` [ns]
// (none: since the first image), where that leaves no two images to choose from.
[[nodiscard]] std::vector<std::optional<std::size_t>> partnersByTime(
    std::span<const std::int64_t> left, std::span<const std::int64_t> right, double tolerance,
    std::optional<std::int64_t> start = std::nullopt);

}  // namespace fathom::topside
