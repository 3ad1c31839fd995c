#include "recon/import/images/stereo_files.hpp"

#include <glob.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <map>
#include <set>
#include <tuple>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/import/csv_columns.hpp"
#include "recon/import/images/name_times.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;

constexpr int kDeep = 3;  // folders below a named one that are looked into

struct Words {
  std::string left, right;
  bool folders_only = false;  // too common in files' names
};
// As people tell their cameras apart, the clearest first.
const std::array kWords = {Words{"left", "right"},
                           Words{"port", "starboard"},
                           Words{"port", "stbd"},
                           Words{"lc16", "rm16"},
                           Words{"cam0", "cam1"},
                           Words{"cam1", "cam2"},
                           Words{"camera0", "camera1"},
                           Words{"camera1", "camera2"},
                           Words{"camera_0", "camera_1"},
                           Words{"camera_1", "camera_2"},
                           Words{"cam_0", "cam_1"},
                           Words{"cam_1", "cam_2"},
                           Words{"image_0", "image_1", true},
                           Words{"image_2", "image_3", true},
                           Words{"im0", "im1"},
                           Words{"l", "r"},
                           Words{"0", "1", true},
                           Words{"1", "2", true},
                           Words{"a", "b", true}};

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

bool looksLikeImage(const fs::path& path) {
  static const std::set<std::string> kExtensions{".tif", ".tiff", ".png", ".jpg", ".jpeg",
                                                 ".bmp", ".pgm",  ".ppm", ".jp2", ".webp"};
  return kExtensions.contains(lower(path.extension().string()));
}

// What this project's programs leave in a dive's folder: pictures of it, not images.
bool isResult(const fs::path& folder) {
  static const std::set<std::string> kResults{"topside", "topside.work", "onboard",
                                              "monitor", "truth",        "masks"};
  const std::string name = folder.filename().string();
  return name.front() == '.' || kResults.contains(name) || fs::exists(folder / "scene.json");
}

void addFolder(const fs::path& folder, int deep, std::vector<fs::path>& out) {
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.is_regular_file() && looksLikeImage(entry.path())) out.push_back(entry.path());
    if (deep > 0 && entry.is_directory() && !isResult(entry.path())) addFolder(entry.path(), deep - 1, out);
  }
}

}  // namespace

std::vector<fs::path> filesMatching(const std::string& pattern, const char* option) {
  ::glob_t found{};
  std::vector<fs::path> out;
  if (::glob(pattern.c_str(), 0, nullptr, &found) == 0)
    for (std::size_t k = 0; k < found.gl_pathc; ++k) out.emplace_back(found.gl_pathv[k]);
  ::globfree(&found);
  if (out.empty()) throw InputError(option, pattern, "matches no file; quote the pattern and check it");
  std::sort(out.begin(), out.end(),
            [](const fs::path& a, const fs::path& b) { return naturallyBefore(a.string(), b.string()); });
  return out;
}

std::vector<fs::path> picturesIn(const fs::path& folder) {
  std::vector<fs::path> files;
  addFolder(folder, kDeep, files);
  std::sort(files.begin(), files.end());
  return files;
}

namespace {

// A word stands alone where no letter continues its letters and no digit its digits; long words are found
// within others too.
bool standsAlone(const std::string& text, std::size_t at, const std::string& word) {
  constexpr std::size_t kLong = 4;
  const auto continues = [](char a, char b) {
    return (isDigit(a) && isDigit(b)) || (std::isalpha(static_cast<unsigned char>(a)) != 0 &&
                                          std::isalpha(static_cast<unsigned char>(b)) != 0);
  };
  const std::size_t end = at + word.size();
  const bool free_before = at == 0 || !continues(text[at - 1], word.front());
  const bool free_behind = end == text.size() || !continues(word.back(), text[end]);
  return (free_before && free_behind) || (word.size() >= kLong && !isDigit(word.back()));
}

// `text` with every `word` in it made '*'; none: it is not there.
std::optional<std::string> without(std::string text, const std::string& word) {
  bool found = false;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) {
    if (!standsAlone(text, at, word)) continue;
    text.replace(at, word.size(), "*");
    found = true;
  }
  return found ? std::optional(text) : std::nullopt;
}

using Sides = std::array<std::vector<fs::path>, 2>;

// What words make of files: those whose names agree but for the word, and the others by side.
struct SidesFound {
  std::vector<StereoFilePair> pairs;
  Sides alone;
};

SidesFound sidesBy(const Words& words, const std::vector<fs::path>& files, const fs::path& root) {
  struct Slot {
    fs::path file;
    bool twice = false;
  };
  std::map<std::string, std::array<Slot, 2>> by_key;
  for (const fs::path& file : files) {
    const fs::path name = file.lexically_relative(root);
    const std::string folder = lower(name.parent_path().generic_string()), stem = lower(name.stem().string());
    std::array<std::optional<std::string>, 2> key;
    for (const auto& [side, word] : {std::pair(0U, words.left), std::pair(1U, words.right)}) {
      const auto in_folder = without(folder, word);
      const auto in_stem = words.folders_only ? std::nullopt : without(stem, word);
      if (in_folder || in_stem) key[side] = in_folder.value_or(folder) + "/" + in_stem.value_or(stem);
    }
    // A folder named left that holds right_1.png tells nothing.
    if (key[0].has_value() == key[1].has_value()) continue;
    const std::size_t side = key[0] ? 0 : 1;
    Slot& slot = by_key[*key[side]][side];
    slot.twice = !slot.file.empty();
    slot.file = file;
  }
  SidesFound found;
  for (const auto& [key, two] : by_key) {
    if (!two[0].file.empty() && !two[1].file.empty() && !two[0].twice && !two[1].twice) {
      found.pairs.push_back({two[0].file, two[1].file, {}});
      continue;
    }
    for (const std::size_t side : {0U, 1U})
      if (!two[side].file.empty()) found.alone[side].push_back(two[side].file);
  }
  return found;
}

// Left and right files whose names share nothing: by times, or in order.
void pairTheRest(Sides& alone, double tolerance, StereoFiles& out) {
  for (auto& files : alone)
    std::sort(files.begin(), files.end(),
              [](const fs::path& a, const fs::path& b) { return naturallyBefore(a.string(), b.string()); });
  std::array<std::vector<std::int64_t>, 2> times;
  for (const std::size_t side : {0U, 1U}) {
    for (const fs::path& file : alone[side])
      if (const auto time = NameTime::usualOf(file.stem().string())) times[side].push_back(*time);
    if (times[side].size() != alone[side].size() || !std::is_sorted(times[side].begin(), times[side].end()))
      times[side].clear();
  }
  Sides left_over;
  if (!times[0].empty() && !times[1].empty()) {
    const auto partners = partnersByTime(times[0], times[1], tolerance);
    std::vector<bool> taken(alone[1].size(), false);
    for (std::size_t k = 0; k < partners.size(); ++k) {
      if (!partners[k]) {
        left_over[0].push_back(alone[0][k]);
        continue;
      }
      taken[*partners[k]] = true;
      out.pairs.push_back({alone[0][k], alone[1][*partners[k]], {}});
    }
    for (std::size_t k = 0; k < taken.size(); ++k)
      if (!taken[k]) left_over[1].push_back(alone[1][k]);
  } else if (out.pairs.empty() && !alone[0].empty() && alone[0].size() == alone[1].size()) {
    for (std::size_t k = 0; k < alone[0].size(); ++k) out.pairs.push_back({alone[0][k], alone[1][k], {}});
    out.assumed.push_back("left and right images have other names, as many of both: paired in order of name");
  } else {
    left_over = std::move(alone);
  }
  for (const fs::path& file : left_over[0]) out.alone.push_back({file, "right"});
  for (const fs::path& file : left_over[1]) out.alone.push_back({file, "left"});
}

StereoFiles tellApart(const std::vector<fs::path>& named, double tolerance) {
  std::vector<fs::path> files;
  fs::path root = fs::is_directory(named.front()) ? named.front() : named.front().parent_path();
  for (const fs::path& path : named) {
    std::error_code error;
    if (fs::is_directory(path, error)) {
      addFolder(path, kDeep, files);
    } else if (fs::is_regular_file(path, error)) {
      files.push_back(path);
    } else {
      throw InputError(path.string(), "", "is not there; name image files or a folder of them");
    }
  }
  std::sort(files.begin(), files.end());
  files.erase(std::unique(files.begin(), files.end()), files.end());

  StereoFiles out;
  SidesFound best;
  const Words* by = nullptr;
  const auto worth = [](const SidesFound& t) {
    return std::tuple(t.pairs.size(), std::min(t.alone[0].size(), t.alone[1].size()),
                      t.alone[0].size() + t.alone[1].size());
  };
  for (const Words& words : kWords)
    if (SidesFound found = sidesBy(words, files, root); worth(found) > worth(best)) {
      best = std::move(found);
      by = &words;
    }
  out.pairs = std::move(best.pairs);
  pairTheRest(best.alone, tolerance, out);
  if (out.pairs.empty()) {
    std::string why =
        "no pair of a left and a right image among " + std::to_string(files.size()) + " images; ";
    why +=
        out.alone.empty()
            ? "name them left_1 and right_1, put them into folders left/ and right/, or give --left "
              "and --right, or --pairs"
            : out.alone[0].file.filename().string() + ": no " + out.alone[0].missing + " image belongs to it";
    throw InputError(named.front().string(), "", why);
  }
  out.assumed.insert(out.assumed.begin(),
                     "left and right images are distinguished by '" + by->left + "' and '" + by->right + "'");
  const std::size_t used = 2 * out.pairs.size() + out.alone.size();
  if (used < files.size())
    out.assumed.push_back(std::to_string(files.size() - used) + " other images are left out");
  return out;
}

// Files with the same key, one on each side, are pairs.
SidesFound sidesByKey(const Sides& files, const std::array<std::vector<std::string>, 2>& keys) {
  std::map<std::string, std::array<std::vector<std::size_t>, 2>> by_key;
  for (const std::size_t side : {0U, 1U})
    for (std::size_t k = 0; k < keys[side].size(); ++k) by_key[keys[side][k]][side].push_back(k);
  SidesFound out;
  for (const auto& [key, found] : by_key) {
    if (!key.empty() && found[0].size() == 1 && found[1].size() == 1) {
      out.pairs.push_back({files[0][found[0].front()], files[1][found[1].front()], {}});
      continue;
    }
    for (const std::size_t side : {0U, 1U})
      for (const std::size_t k : found[side]) out.alone[side].push_back(files[side][k]);
  }
  return out;
}

// By what `key(side, file)` gives or by the numbers in it, whichever pairs more, and the rest by times.
template <typename Key>
StereoFiles pairedBy(const Sides& files, const Key& key, double tolerance) {
  SidesFound best{{}, files};
  for (const bool numbers : {false, true}) {
    std::array<std::vector<std::string>, 2> keys;
    for (const std::size_t side : {0U, 1U})
      for (const fs::path& file : files[side])
        keys[side].push_back(numbers ? numbersIn(key(side, file)) : key(side, file));
    if (SidesFound found = sidesByKey(files, keys); found.pairs.size() > best.pairs.size())
      best = std::move(found);
  }
  StereoFiles out;
  out.pairs = std::move(best.pairs);
  pairTheRest(best.alone, tolerance, out);
  return out;
}

StereoFiles byPatterns(const StereoFileOptions& options) {
  if (options.left_pattern.empty() || options.right_pattern.empty())
    throw InputError(options.left_pattern.empty() ? "--left" : "--right", "",
                     "is missing; --left and --right go together");
  const Sides files{filesMatching(options.left_pattern, "--left"),
                    filesMatching(options.right_pattern, "--right")};
  const std::array<Wildcards, 2> wildcards{Wildcards(options.left_pattern), Wildcards(options.right_pattern)};
  StereoFiles out = pairedBy(
      files, [&](std::size_t side, const fs::path& file) { return wildcards[side].of(file); },
      options.tolerance);
  if (out.pairs.empty())
    throw InputError("--right", options.right_pattern,
                     "matches " + std::to_string(files[1].size()) +
                         " images, of which none has the name, number or time of one of the " +
                         std::to_string(files[0].size()) + " of --left; give as many of both, or --pairs");
  return out;
}

StereoFiles byList(const fs::path& path) {
  const CsvColumns csv(path);
  const std::size_t left = csv.required("left"), right = csv.required("right");
  const auto utc = csv.column("utc");
  StereoFiles out;
  for (std::size_t row = 0; row < csv.rows(); ++row) {
    StereoFilePair pair{csv.text(row, left), csv.text(row, right), {}};
    for (fs::path* file : {&pair.left, &pair.right}) {
      if (file->is_relative()) *file = path.parent_path() / *file;
      if (!fs::is_regular_file(*file)) csv.fail(row, "names " + file->string() + ", which is not there");
    }
    if (utc) {
      pair.utc_ns = csv.time(row, *utc);
    }
    out.pairs.push_back(std::move(pair));
  }
  if (out.pairs.empty()) throw InputError(path.string(), "", "lists no pair");
  return out;
}

}  // namespace

std::vector<StereoFilePair> partnersByName(const std::vector<fs::path>& left,
                                           const std::vector<fs::path>& others, double tolerance) {
  return pairedBy(
             {left, others}, [](std::size_t, const fs::path& file) { return lower(file.stem().string()); },
             tolerance)
      .pairs;
}

StereoFiles findStereoFiles(const StereoFileOptions& options) {
  const bool patterns = !options.left_pattern.empty() || !options.right_pattern.empty();
  const int forms = (patterns ? 1 : 0) + (options.pairs.empty() ? 0 : 1) + (options.images.empty() ? 0 : 1);
  if (forms == 0)
    throw InputError("IMAGES", "", "are missing; name image files, a folder of them, or --left and --right");
  if (forms > 1 && (patterns || options.images.empty()))
    throw InputError(patterns ? "--left" : "--pairs", "",
                     "stands instead of other images; give one or the other");
  StereoFiles out = !options.pairs.empty() ? byList(options.pairs)
                    : patterns             ? byPatterns(options)
                                           : tellApart(options.images, options.tolerance);
  if (!out.alone.empty()) {
    std::vector<std::string> names;
    for (const StereoFiles::Alone& one : out.alone) names.push_back(one.file.filename().string());
    out.assumed.push_back(leftOut(names.size() == 1
                                      ? "1 image without its partner is"
                                      : std::to_string(names.size()) + " images without their partner are",
                                  names));
  }
  takeTimes(options.time_pattern, out);
  std::stable_sort(out.pairs.begin(), out.pairs.end(), [](const StereoFilePair& a, const StereoFilePair& b) {
    if (a.utc_ns && b.utc_ns) return *a.utc_ns < *b.utc_ns;
    return naturallyBefore(a.left.string(), b.left.string());
  });
  return out;
}

std::vector<std::optional<std::size_t>> partnersByTime(std::span<const std::int64_t> left,
                                                       std::span<const std::int64_t> right, double tolerance,
                                                       std::optional<std::int64_t> start) {
  constexpr std::int64_t kSkewFollow = 8;     // pairs
  constexpr std::int64_t kDriftShare = 5000;  // of a time, for two clocks of 100 ppm
  const std::int64_t limit = rt::nanoseconds(tolerance);
  std::int64_t skew_ns = 0, period = 0;
  for (std::size_t k = 1; k < left.size(); ++k)
    if (left[k] > left[k - 1] && (period == 0 || left[k] - left[k - 1] < period))
      period = left[k] - left[k - 1];
  std::int64_t paired = start.value_or(left.empty() ? 0 : left.front());
  std::size_t r = 0;
  std::vector<std::optional<std::size_t>> partners(left.size());
  for (std::size_t k = 0; k < left.size(); ++k) {
    const auto apart = [&](std::size_t at) { return std::abs(right[at] - skew_ns - left[k]); };
    while (r + 1 < right.size() && apart(r + 1) <= apart(r)) ++r;
    const std::int64_t drift = std::max<std::int64_t>(left[k] - paired, 0) / kDriftShare;
    const std::int64_t within = limit + (2 * drift + limit < period ? drift : 0);
    if (r >= right.size() || apart(r) > within) continue;
    const std::int64_t off = right[r] - left[k] - skew_ns;
    skew_ns += std::abs(off) > limit ? off : off / kSkewFollow;
    paired = left[k];
    partners[k] = r++;
  }
  return partners;
}

}  // namespace fathom::topside
