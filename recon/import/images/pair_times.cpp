#include "recon/import/images/pair_times.hpp"

#include <gdal_priv.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <set>

#include "realtime/base/input_error.hpp"
#include "recon/import/images/name_times.hpp"

namespace fathom::topside {
namespace {

using TimeOf = std::function<std::optional<std::int64_t>(const std::filesystem::path& left)>;

// True, and all pairs have times, if most are known and all of these differ; the others are left out.
bool timeBy(const TimeOf& timeOf, StereoFiles& files) {
  std::vector<StereoFilePair> timed;
  std::vector<std::string> untimed;
  std::set<std::int64_t> different;
  for (const StereoFilePair& pair : files.pairs) {
    const auto time = timeOf(pair.left);
    if (time && !different.insert(*time).second) return false;
    if (time)
      timed.push_back({pair.left, pair.right, time});
    else
      untimed.push_back(pair.left.filename().string());
  }
  if (timed.size() <= untimed.size()) return false;
  if (!untimed.empty())
    files.assumed.push_back(leftOut(std::to_string(untimed.size()) + " of " +
                                        std::to_string(files.pairs.size()) +
                                        (untimed.size() == 1 ? " pairs has no time in its name and is"
                                                             : " pairs have no time in their names and are"),
                                    untimed));
  files.pairs = std::move(timed);
  return true;
}

TimeOf inNames(const NameTime& form) {
  return [&form](const std::filesystem::path& left) { return form.of(left.stem().string()); };
}

}  // namespace

std::string leftOut(const std::string& which, const std::vector<std::string>& names) {
  constexpr std::size_t kNamed = 5;
  std::string text = which + " left out: ";
  for (std::size_t k = 0; k < std::min(names.size(), kNamed); ++k) text += (k > 0 ? ", " : "") + names[k];
  return names.size() > kNamed ? text + " ..." : text;
}

std::optional<std::int64_t> exifTime(const std::filesystem::path& image) {
  static const NameTime kWhole("%Y:%m:%d %H:%M:%S"), kFraction("%Y:%m:%d %H:%M:%S.%f");
  GDALAllRegister();
  const CPLErrorHandlerPusher quiet(CPLQuietErrorHandler);
  const std::unique_ptr<GDALDataset> set(GDALDataset::Open(image.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY));
  const char* time = set ? set->GetMetadataItem("EXIF_DateTimeOriginal") : nullptr;
  if (time == nullptr) return std::nullopt;
  const char* fraction = set->GetMetadataItem("EXIF_SubSecTime_Original");
  std::string digits = fraction == nullptr ? "" : fraction;
  digits.erase(std::remove_if(digits.begin(), digits.end(), [](char c) { return c < '0' || c > '9'; }),
               digits.end());
  if (digits.empty()) return kWhole.of(time);
  constexpr std::size_t kNanoseconds = 9;
  digits.resize(kNanoseconds, '0');
  return kFraction.of(time + ("." + digits));
}

void takeTimes(const std::string& pattern, StereoFiles& files) {
  const std::vector<StereoFilePair>& pairs = files.pairs;
  if (!pattern.empty()) {
    const NameTime form(pattern);
    for (const StereoFilePair& pair : pairs)
      if (!form.of(pair.left.stem().string()))
        throw InputError("--time-pattern", pattern, "does not fit " + pair.left.filename().string());
    if (!timeBy(inNames(form), files))
      throw InputError("--time-pattern", pattern,
                       "gives several pairs one time; name the fraction of a second with %f");
    return;
  }
  if (std::all_of(pairs.begin(), pairs.end(), [](const StereoFilePair& p) { return p.utc_ns.has_value(); }))
    return;
  for (const NameTime& form : NameTime::usual())
    if (timeBy(inNames(form), files)) {
      files.assumed.push_back("times are those in the left images' names, UTC");
      return;
    }
  if (timeBy(exifTime, files)) {
    files.assumed.push_back("times are those in the left images' EXIF, as if UTC");
    return;
  }
  for (StereoFilePair& pair : files.pairs) pair.utc_ns.reset();
  files.assumed.push_back(
      "no times in names or EXIF that differ: pairs are taken in order of name, half a second apart");
}

}  // namespace fathom::topside
