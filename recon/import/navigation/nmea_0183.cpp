#include "recon/import/navigation/nav_csv.hpp"

#include <charconv>
#include <cmath>
#include <fstream>
#include <functional>
#include <map>
#include <numbers>

#include "realtime/base/civil_time.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/import/images/name_times.hpp"

namespace fathom::topside {
namespace {

constexpr double kKnot = 1852.0 / 3600;
constexpr std::int64_t kDay = 86'400 * kSecond_ns;

// A sentence's fields behind its name; those that are absent are empty.
class Fields {
 public:
  explicit Fields(std::string_view text) {
    for (std::size_t at = 0; at <= text.size();) {
      const std::size_t end = std::min(text.find(',', at), text.size());
      all_.emplace_back(text.substr(at, end - at));
      at = end + 1;
    }
  }

  [[nodiscard]] const std::string& text(std::size_t k) const {
    static const std::string kNothing;
    return k < all_.size() ? all_[k] : kNothing;
  }
  [[nodiscard]] std::optional<double> number(std::size_t k) const {
    const std::string& field = text(k);
    double value = 0;
    const char* begin = field.data() + (!field.empty() && field.front() == '+' ? 1 : 0);
    const auto [end, error] = std::from_chars(begin, field.data() + field.size(), value);
    if (field.empty() || error != std::errc() || end != field.data() + field.size() || !std::isfinite(value))
      return {};
    return value;
  }
  // ddmm.mmmm and its hemisphere [rad].
  [[nodiscard]] std::optional<double> angle(std::size_t k, double most) const {
    const auto value = number(k);
    if (!value || *value < 0) return {};
    const double degrees = std::floor(*value / 100);
    const double angle = (degrees + (*value - 100 * degrees) / 60) * kRadiansPerDegree;
    if (angle > most) return {};
    const std::string& side = text(k + 1);
    return side == "S" || side == "W" ? -angle : angle;
  }
  [[nodiscard]] std::size_t size() const { return all_.size(); }

 private:
  std::vector<std::string> all_;
};

// hhmmss.sss, from midnight [ns].
std::optional<std::int64_t> timeOfDay(const Fields& fields, std::size_t k) {
  const auto value = fields.number(k);
  if (!value || *value < 0 || *value >= 240'000) return {};
  const auto whole = static_cast<std::int64_t>(*value);
  const std::int64_t hours = whole / 10'000, minutes = whole / 100 % 100, seconds = whole % 100;
  if (minutes > 59 || seconds > 60) return {};
  return (hours * 3600 + minutes * 60 + seconds) * kSecond_ns +
         std::llround((*value - static_cast<double>(whole)) * 1e9);
}

class NmeaReader {
 public:
  NmeaReader(double declination, std::optional<std::int64_t> about)
      : declination_(declination), about_(about) {}

  // Of the logger, at the head of the line.
  void logged(std::int64_t utc_ns) {
    now_ = utc_ns;
    by_logger_ = true;
  }

  void sentence(std::string_view name, const Fields& f) {
    const auto known = kinds().find(std::string(name));
    if (known != kinds().end()) known->second(*this, f);
  }

  NavData data;
  bool undated = false;  // a time of day that no date goes with
  bool magnetic = false;

 private:
  using Kind = std::function<void(NmeaReader&, const Fields&)>;

  static const std::map<std::string, Kind>& kinds() {
    static const std::map<std::string, Kind> all{
        {"GGA", [](NmeaReader& r, const Fields& f) { r.gga(f); }},
        {"GLL",
         [](NmeaReader& r, const Fields& f) {
           r.timed(timeOfDay(f, 4));
           if (f.text(5) != "V") r.position(f, 0);
         }},
        {"RMC",
         [](NmeaReader& r, const Fields& f) {
           r.dated(f.number(8));
           r.timed(timeOfDay(f, 0));
           if (f.text(1) != "V") r.position(f, 2);
         }},
        {"ZDA", [](NmeaReader& r, const Fields& f) { r.zda(f); }},
        {"HDT", [](NmeaReader& r, const Fields& f) { r.heading(f.number(0)); }},
        {"THS",
         [](NmeaReader& r, const Fields& f) {
           if (f.text(1) != "V") r.heading(f.number(0));
         }},
        {"HDM", [](NmeaReader& r, const Fields& f) { r.magneticHeading(f.number(0), {}); }},
        {"HDG",
         [](NmeaReader& r, const Fields& f) {
           const double deviation = f.number(1).value_or(0) * (f.text(2) == "W" ? -1 : 1);
           auto variation = f.number(3);
           if (variation && f.text(4) == "W") variation = -*variation;
           auto compass = f.number(0);
           if (compass) compass = *compass + deviation;
           r.magneticHeading(compass, variation);
         }},
        {"VTG",
         [](NmeaReader& r, const Fields& f) {
           const auto course = f.number(0), speed = f.number(4);
           if (course && speed)
             r.add(r.data.track, {*speed * kKnot * std::cos(*course * kRadiansPerDegree),
                                  *speed * kKnot * std::sin(*course * kRadiansPerDegree), 0});
         }},
        {"VBW",
         [](NmeaReader& r, const Fields& f) {
           const auto forward = f.number(3), starboard = f.number(4);
           if (forward && starboard && f.text(5) != "V")
             r.add(r.data.velocity, {*forward * kKnot, *starboard * kKnot, 0});
         }},
        {"DBT", [](NmeaReader& r, const Fields& f) { r.altitude(f.number(2)); }},
        {"DPT", [](NmeaReader& r, const Fields& f) { r.altitude(f.number(0)); }},
        {"XDR", [](NmeaReader& r, const Fields& f) { r.xdr(f); }},
        {"PASHR",
         [](NmeaReader& r, const Fields& f) {
           r.timed(timeOfDay(f, 0));
           r.heading(f.number(1));
           r.tilt(f.number(3), f.number(4));
         }},
        {"PRDID",
         [](NmeaReader& r, const Fields& f) {
           r.tilt(f.number(1), f.number(0));
           r.heading(f.number(2));
         }},
        {"PSXN", [](NmeaReader& r, const Fields& f) {
           if (f.text(0) != "23") return;
           r.tilt(f.number(1), f.number(2));
           r.heading(f.number(3));
         }}};
    return all;
  }

  void add(std::vector<NavRow>& rows, const Eigen::Vector3d& value) {
    if (now_) rows.push_back({*now_, value});
  }
  void position(const Fields& f, std::size_t k) {
    const auto latitude = f.angle(k, 0.5 * std::numbers::pi), longitude = f.angle(k + 2, std::numbers::pi);
    if (latitude && longitude) add(data.position, {*latitude, *longitude, 0});
  }
  void gga(const Fields& f) {
    timed(timeOfDay(f, 0));
    if (f.text(5) != "0") position(f, 1);
  }
  void zda(const Fields& f) {
    const auto day = f.number(1), month = f.number(2), year = f.number(3);
    if (day && month && year) date(*day, *month, *year);
    timed(timeOfDay(f, 0));
  }
  void heading(std::optional<double> degrees) {
    if (degrees) add(data.heading, {*degrees * kRadiansPerDegree, 0, 0});
  }
  void magneticHeading(std::optional<double> degrees, std::optional<double> variation) {
    if (!degrees) return;
    magnetic = magnetic || !variation;
    add(data.heading,
        {*degrees * kRadiansPerDegree + (variation ? *variation * kRadiansPerDegree : declination_), 0, 0});
  }
  void tilt(std::optional<double> roll, std::optional<double> pitch) {
    if (roll && pitch) add(data.tilt, {*roll * kRadiansPerDegree, *pitch * kRadiansPerDegree, 0});
  }
  void altitude(std::optional<double> metres) {
    if (metres && *metres > 0) add(data.altitude, {*metres, 0, 0});
  }
  // Four fields a transducer: kind, value, unit, name.
  void xdr(const Fields& f) {
    std::optional<double> roll, pitch;
    for (std::size_t k = 0; k + 3 < f.size(); k += 4) {
      std::string name = f.text(k + 3);
      for (char& c : name) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
      const auto is = [&](const char* word) { return name.find(word) != std::string::npos; };
      if (f.text(k) == "A" && (is("PITCH") || is("PTCH"))) pitch = f.number(k + 1);
      if (f.text(k) == "A" && is("ROLL")) roll = f.number(k + 1);
      if (f.text(k) == "D" && is("DEPTH"))
        if (const auto depth = f.number(k + 1)) add(data.depth, {*depth, 0, 0});
    }
    tilt(roll, pitch);
  }

  void date(double day, double month, double year) {
    io::CivilTime civil;
    civil.year = static_cast<int>(year);
    civil.month = static_cast<int>(month);
    civil.day = static_cast<int>(day);
    midnight_ = io::utcFromCivil(civil);
  }
  // ddmmyy.
  void dated(std::optional<double> ddmmyy) {
    if (!ddmmyy || *ddmmyy < 0 || *ddmmyy > 311'299) return;
    const int whole = static_cast<int>(*ddmmyy), year = whole % 100;
    const int day = whole / 10'000, month = whole / 100 % 100;
    constexpr int kCentury = 80;  // 80 is 1980, when GPS began
    date(day, month, year + (year < kCentury ? 2000 : 1900));
  }
  // A time of day: of the date given, else of the day that puts it nearest to the images.
  void timed(std::optional<std::int64_t> of_day) {
    if (!of_day || by_logger_) return;
    if (!midnight_ && !about_) {
      undated = true;
      return;
    }
    std::int64_t t = midnight_.value_or(*about_ - *about_ % kDay) + *of_day;
    const std::int64_t near = now_ ? *now_ : midnight_ ? t : *about_;
    if (t - near > kDay / 2) t -= kDay;
    if (near - t > kDay / 2) t += kDay;  // midnight passed, and no date since
    now_ = t;
  }

  double declination_;
  std::optional<std::int64_t> about_, midnight_, now_;
  bool by_logger_ = false;
};

// Whether the two digits behind '*' are the exclusive or of what stands between '$' and '*'.
bool checksumHolds(std::string_view sentence, std::string_view digits) {
  unsigned sum = 0;
  for (const char c : sentence) sum ^= static_cast<unsigned char>(c);
  unsigned said = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), said, 16);
  return error == std::errc() && end == digits.data() + digits.size() && said == sum;
}

}  // namespace

NavData readNmea(const std::filesystem::path& path, double declination,
                 std::optional<std::int64_t> about_utc_ns) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw InputError(path.string(), "", "cannot be read");
  NmeaReader reader(declination, about_utc_ns);
  std::size_t damaged = 0, good = 0;
  for (std::string line; std::getline(in, line);) {
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
    const std::size_t begin = line.find('$');
    if (begin == std::string::npos) continue;
    std::string_view sentence = std::string_view(line).substr(begin + 1);
    if (const std::size_t star = sentence.find('*'); star != std::string_view::npos) {
      if (!checksumHolds(sentence.substr(0, star), sentence.substr(star + 1, 2))) {
        ++damaged;
        continue;
      }
      sentence = sentence.substr(0, star);
    }
    const std::size_t comma = sentence.find(',');
    if (comma == std::string_view::npos) continue;
    ++good;
    if (begin > 0)
      if (const auto t = NameTime::usualOf(line.substr(0, begin))) reader.logged(*t);
    const std::string_view name = sentence.substr(0, comma);
    // A talker's two letters and the sentence's three; makers' own begin with P.
    reader.sentence(name.starts_with('P') || name.size() < 5 ? name : name.substr(name.size() - 3),
                    Fields(sentence.substr(comma + 1)));
  }
  if (reader.data.empty() && reader.undated)
    throw InputError(path.string(), "",
                     "has times of day without a date (no RMC or ZDA), and the images have no times either");
  std::vector<std::string>& assumed = reader.data.assumed;
  assumed.push_back("navigation from " + path.filename().string() + ": NMEA 0183, " + std::to_string(good) +
                    " sentences" +
                    (damaged > 0 ? ", " + std::to_string(damaged) + " with a wrong checksum left out" : ""));
  if (reader.magnetic) assumed.push_back("headings without a variation are magnetic: --declination is added");
  return std::move(reader.data);
}

}  // namespace fathom::topside
