#include "recon/import/images/name_times.hpp"

#include <gdal_priv.h>
#include <algorithm>
#include <functional>
#include <memory>
#include <set>
#include <string_view>

#include "realtime/base/civil_time.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::topside {

bool naturallyBefore(const std::string& a, const std::string& b) {
  std::size_t i = 0, k = 0;
  while (i < a.size() && k < b.size()) {
    if (isDigit(a[i]) && isDigit(b[k])) {
      const auto number = [](const std::string& text, std::size_t& at) {
        while (at < text.size() && text[at] == '0') ++at;
        const std::size_t from = at;
        while (at < text.size() && isDigit(text[at])) ++at;
        return text.substr(from, at - from);
      };
      const std::string x = number(a, i), y = number(b, k);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
    } else if (a[i] != b[k]) {
      return a[i] < b[k];
    } else {
      ++i, ++k;
    }
  }
  return a.size() - i != b.size() - k ? a.size() - i < b.size() - k : a < b;
}

std::string numbersIn(const std::string& text) {
  std::string out;
  for (std::size_t k = 0; k < text.size(); ++k) {
    if (!isDigit(text[k])) continue;
    const std::size_t end = std::min(text.find_first_not_of("0123456789", k), text.size()),
                      from = std::min(text.find_first_not_of('0', k), end - 1);
    out += text.substr(from, end - from) + "/";
    k = end;
  }
  return out;
}

Wildcards::Wildcards(const std::string& pattern) {
  std::string form;
  for (std::size_t k = 0; k < pattern.size(); ++k) {
    const char c = pattern[k];
    const std::size_t close = c == '[' ? pattern.find(']', k + 2) : std::string::npos;
    if (c == '*' || c == '?') {
      form += c == '*' ? "([^/]*)" : "([^/])";
    } else if (close != std::string::npos) {
      std::string set = pattern.substr(k + 1, close - k - 1);
      if (set.front() == '!') set.front() = '^';
      form += "([" + set + "])";
      k = close;
    } else {
      const char literal = c == '\\' && k + 1 < pattern.size() ? pattern[++k] : c;
      if (std::string_view(R"(\^$.|?*+()[]{})").find(literal) != std::string_view::npos) form += '\\';
      form += literal;
    }
  }
  try {
    form_ = std::regex(form);
  } catch (const std::regex_error&) {
    form_ = std::regex();  // a set of a shell's own, [[:upper:]]: nothing matches
  }
}

std::string Wildcards::of(const std::filesystem::path& file) const {
  std::smatch found;
  const std::string name = file.string();
  std::string out;
  if (std::regex_match(name, found, form_))
    for (std::size_t k = 1; k < found.size(); ++k) out += found[k].str() + "/";
  return out;
}

namespace {

constexpr std::size_t kNanoDigits = 9;

// "049" to 49'000'000 ns.
std::int64_t fractionNs(std::string digits) {
  digits.resize(kNanoDigits, '0');
  return std::stoll(digits);
}

}  // namespace

NameTime::NameTime(const std::string& pattern) {
  std::string form;
  for (std::size_t k = 0; k < pattern.size(); ++k) {
    if (pattern[k] != '%') {
      if (std::string_view(R"(\^$.|?*+()[]{})").find(pattern[k]) != std::string_view::npos) form += '\\';
      form += pattern[k];
      continue;
    }
    const char field = ++k < pattern.size() ? pattern[k] : ' ';
    switch (field) {
      case 'Y':
        form += "(\\d{4})";
        break;
      case 'm':
      case 'd':
      case 'H':
      case 'M':
      case 'S':
        form += "(\\d{2})";
        break;
      case 's':
        form += "(\\d{10})";
        break;
      case 'f':
        form += "(\\d{1,9})";
        break;
      default:
        throw InputError("--time-pattern", pattern,
                         "has %" + std::string(1, field) + "; known are %Y %m %d %H %M %S %s %f");
    }
    fields_ += field;
  }
  const auto has = [&](const char* all) {
    return std::all_of(all, all + std::char_traits<char>::length(all),
                       [&](char f) { return std::count(fields_.begin(), fields_.end(), f) == 1; });
  };
  if (!has("YmdHMS") && !has("s"))
    throw InputError("--time-pattern", pattern,
                     "tells no time; give each of %Y %m %d %H %M %S once, or %s, such as "
                     "'img_%Y%m%d_%H%M%S_%f'");
  form_ = std::regex(form);
}

std::optional<std::int64_t> NameTime::of(const std::string& name) const {
  std::smatch found;
  if (!std::regex_search(name, found, form_)) return std::nullopt;
  io::CivilTime civil;
  std::optional<std::int64_t> unix_ns;
  std::int64_t fraction = 0;
  for (std::size_t k = 0; k < fields_.size(); ++k) {
    const std::string digits = found[k + 1].str();
    if (fields_[k] == 's') {
      unix_ns = std::stoll(digits) * kSecond_ns;
    } else if (fields_[k] == 'f') {
      if (!digits.empty()) fraction = fractionNs(digits);
    } else {
      constexpr std::string_view kFields = "YmdHMS";
      int* const to[] = {&civil.year, &civil.month, &civil.day, &civil.hour, &civil.minute, &civil.second};
      *to[kFields.find(fields_[k])] = std::stoi(digits);
    }
  }
  const std::optional<std::int64_t> whole = unix_ns ? unix_ns : io::utcFromCivil(civil);
  if (!whole) return std::nullopt;
  return *whole + fraction;
}

std::optional<std::int64_t> NameTime::usualOf(const std::string& name) {
  for (const NameTime& form : usual())
    if (const auto time = form.of(name)) return time;
  return std::nullopt;
}

const std::vector<NameTime>& NameTime::usual() {
  static const std::vector<NameTime> kUsual = [] {
    // Behind a decimal point any digits are a fraction; else a number might count images.
    const std::string before = "(?:^|\\D)", after = "(?:\\D|$)",
                      fraction = "(?:[.,](\\d{1,9})|[-_]?(\\d{3}|\\d{6}|\\d{9}))?";
    const std::string date = "((?:19|20)\\d{2})[-_.]?(\\d{2})[-_.]?(\\d{2})",
                      time = "(\\d{2})[-_.:]?(\\d{2})[-_.:]?(\\d{2})";
    return std::vector<NameTime>{
        {std::regex(before + date + "[-_.T ]?" + time + fraction + "Z?" + after), "YmdHMSff"},
        {std::regex(before + "(1\\d{9})" + fraction + after), "sff"}};
  }();
  return kUsual;
}

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
