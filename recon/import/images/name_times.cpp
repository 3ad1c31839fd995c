#include "recon/import/images/name_times.hpp"

#include <algorithm>
#include <string_view>

#include "realtime/base/civil_time.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::topside {
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

}  // namespace fathom::topside
