#include "firmware_if/mission/log/raw_auv.hpp"

#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <string_view>
#include <vector>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr double kAbsentNumber = -9999.0;
constexpr std::size_t kMaxLineBytes = 4096;
constexpr std::string_view kCompassLine = "PHINS_COMPASS:";

std::optional<double> parseNumber(std::string_view text) {
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  double value = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec != std::errc() || result.ptr != text.data() + text.size() || !std::isfinite(value))
    return std::nullopt;
  return value;
}

// Decimal seconds to ns exactly: a double resolves only some 200 ns in this century.
std::optional<std::int64_t> parseSeconds(std::string_view text) {
  const std::size_t point = std::min(text.find('.'), text.size());
  std::int64_t seconds = 0;
  const auto result = std::from_chars(text.data(), text.data() + point, seconds);
  constexpr std::int64_t kLastSecond = 9'223'372'035;  // of int64 nanoseconds
  if (point == 0 || result.ec != std::errc() || result.ptr != text.data() + point || seconds < 0 ||
      seconds > kLastSecond)
    return std::nullopt;
  std::int64_t fraction = 0, unit = 100'000'000;
  for (std::size_t i = point + 1; i < text.size(); ++i) {
    if (text[i] < '0' || text[i] > '9') return std::nullopt;
    fraction += (text[i] - '0') * unit;
    unit /= 10;
  }
  return seconds * kSecond_ns + fraction;
}

std::vector<std::string_view> splitWords(std::string_view line) {
  std::vector<std::string_view> words;
  for (std::size_t i = 0; i < line.size();) {
    const auto space = [&](std::size_t at) {
      return std::isspace(static_cast<unsigned char>(line[at])) != 0;
    };
    while (i < line.size() && space(i)) ++i;
    const std::size_t begin = i;
    while (i < line.size() && !space(i)) ++i;
    if (i > begin) words.push_back(line.substr(begin, i - begin));
  }
  return words;
}

// "key:value", "key: value" and plain words; values of unknown keys are kept, so that order and spelling are
// free.
class RawAuvFields {
 public:
  explicit RawAuvFields(const std::vector<std::string_view>& words) {
    for (std::size_t i = 0; i < words.size(); ++i) {
      const std::size_t colon = words[i].find(':');
      if (colon == std::string_view::npos) {
        good_ = false;
        continue;
      }
      const std::string_view key = words[i].substr(0, colon);
      std::string_view value = words[i].substr(colon + 1);
      if (value.empty() && i + 1 < words.size()) value = words[++i];
      const auto number = parseNumber(value);
      if (!number) good_ = false;
      values_[key] = number.value_or(kAbsentNumber);
    }
  }
  [[nodiscard]] bool good() const { return good_; }
  [[nodiscard]] std::optional<double> get(std::string_view key) const {
    const auto found = values_.find(key);
    if (found == values_.end() || found->second == kAbsentNumber) return std::nullopt;
    return found->second;
  }
  // A distance; zero and less mean that the instrument had none.
  [[nodiscard]] std::optional<double> distance(std::string_view key) const {
    const auto value = get(key);
    return value && *value > 0 ? value : std::nullopt;
  }

 private:
  std::map<std::string_view, double> values_;
  bool good_ = true;
};

std::optional<DvlSample> dvlFrom(std::int64_t utc_ns, const RawAuvFields& fields) {
  DvlSample dvl;
  dvl.utc_ns = utc_ns;
  const auto x = fields.get("vx"), y = fields.get("vy"), z = fields.get("vz");
  if (x && y && z && fields.get("bt_status").value_or(0) == 0) dvl.velocity = Eigen::Vector3d(*x, *y, *z);
  constexpr std::array<std::string_view, 4> kRanges = {"r1", "r2", "r3", "r4"};
  for (std::size_t i = 0; i < 4; ++i) dvl.range[i] = fields.distance(kRanges[i]);
  dvl.altitude = fields.distance("alt");
  dvl.sound_speed = fields.distance("sv").value_or(dvl.sound_speed);
  return dvl;
}

std::optional<AttitudeSample> attitudeFrom(std::int64_t utc_ns, const RawAuvFields& fields, bool magnetic,
                                           std::string_view heading_key) {
  const auto roll = fields.get("r"), pitch = fields.get("p"), heading = fields.get(heading_key);
  if (!roll || !pitch || !heading) return std::nullopt;
  return AttitudeSample{utc_ns, *roll / kDegreesPerRadian, *pitch / kDegreesPerRadian,
                        *heading / kDegreesPerRadian, magnetic};
}

std::string secondsText(std::int64_t utc_ns) {
  const std::int64_t whole = utc_ns / kSecond_ns, rest = utc_ns % kSecond_ns;
  char text[48];
  std::snprintf(text, sizeof text, "%lld.%09lld", static_cast<long long>(whole),
                static_cast<long long>(rest));
  return text;
}

// The shortest decimal that reads back to the same bits; -9999 where absent.
std::string numberText(std::optional<double> value) {
  std::array<char, 40> buffer;
  const auto end =
      std::to_chars(buffer.data(), buffer.data() + buffer.size(), value.value_or(kAbsentNumber)).ptr;
  return {buffer.data(), end};
}

// [deg] in [0, 360).
double compassDegrees(double radians) {
  const double degrees = std::fmod(radians * kDegreesPerRadian, 360.0);
  return degrees < 0 ? degrees + 360.0 : degrees;
}

}  // namespace

RawAuvReader::RawAuvReader(const std::filesystem::path& path, const Geodetic& origin)
    : in_(path, std::ios::binary), projection_(origin) {
  std::error_code error;
  if (!in_ || !std::filesystem::is_regular_file(path, error))
    throw InputError(path, "", "is absent or cannot be read; give a RAW.auv");
  if (in_.peek() == std::ifstream::traits_type::eof()) throw InputError(path, "", "is empty; give a RAW.auv");
  std::string line;
  while (!has_compass_lines_ && readLine(line))
    has_compass_lines_ = std::string_view(line).substr(0, kCompassLine.size()) == kCompassLine;
  rewind();
}

void RawAuvReader::rewind() {
  in_.clear();
  in_.seekg(0);
  pending_.clear();
  skipped_ = damaged_ = 0;
}

// The next line, cut at kMaxLineBytes (the rest of a longer one is passed over).
bool RawAuvReader::readLine(std::string& line) {
  std::array<char, kMaxLineBytes> buffer;
  in_.getline(buffer.data(), buffer.size());
  if (in_.gcount() == 0 && !in_) return false;
  line.assign(buffer.data());
  if (in_.fail() && !in_.eof()) {
    in_.clear();
    in_.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
  }
  return true;
}

std::optional<SensorSample> RawAuvReader::next() {
  std::string line;
  while (pending_.empty() && readLine(line))
    if (!parseLine(line)) ++damaged_;
  if (pending_.empty()) return std::nullopt;
  SensorSample sample = std::move(pending_.front());
  pending_.pop_front();
  return sample;
}

// Puts what the line says into pending_; false when it is of a type that is read, but malformed.
bool RawAuvReader::parseLine(const std::string& line) {
  const std::vector<std::string_view> words = splitWords(line);
  if (words.empty()) return true;
  const std::string_view type = words[0];
  if (type != "PAROSCI:" && type != "RDI:" && type != kCompassLine && type != "SSBL_FIX:" && type != "VIS:") {
    ++skipped_;
    return true;
  }
  if (words.size() < 3) return false;
  const auto utc_ns = parseSeconds(words[1]);
  if (!utc_ns) return false;
  if (type == "PAROSCI:") {
    const auto depth = parseNumber(words[2]);
    if (!depth || words.size() > 3) return false;
    if (*depth != kAbsentNumber) pending_.emplace_back(DepthSample{*utc_ns, *depth});
    return true;
  }
  if (type == "VIS:") {
    // The second time, in brackets, is the trigger's; writers leave it out or write it bare.
    const std::size_t name_at = words[2].front() == '[' || parseNumber(words[2]) ? 3 : 2;
    if (words.size() <= name_at) return false;
    const auto name = parseImageFileName(std::string(words[name_at]));
    const RawAuvFields fields({words.begin() + static_cast<std::ptrdiff_t>(name_at) + 1, words.end()});
    if (!name || !fields.good()) return false;
    const double exposure_s = fields.distance("exp").value_or(0.0) / kMicrosecondsPerSecond;
    pending_.emplace_back(ImageEvent{*utc_ns, name->side, words[name_at], exposure_s});
    return true;
  }
  const RawAuvFields fields({words.begin() + 2, words.end()});
  if (!fields.good()) return false;
  if (type == "RDI:") {
    pending_.emplace_back(*dvlFrom(*utc_ns, fields));
    if (has_compass_lines_) return true;
    const bool has_true = fields.get("h_true").has_value();
    if (const auto attitude = attitudeFrom(*utc_ns, fields, !has_true, has_true ? "h_true" : "h"))
      pending_.emplace_back(*attitude);
    return true;
  }
  if (type == kCompassLine) {
    const auto attitude = attitudeFrom(*utc_ns, fields, false, "h");
    if (attitude) pending_.emplace_back(*attitude);
    return attitude.has_value();
  }
  const auto north = fields.get("target_x"), east = fields.get("target_y"), depth = fields.get("target_z");
  if (!north || !east || !depth) return false;
  constexpr double kFarthest = 1e6;  // [m] from the origin; beyond, the local projection means nothing
  if (std::abs(*north) > kFarthest || std::abs(*east) > kFarthest) return false;
  constexpr double kRangeSigma = 0.2;                         // [m]
  constexpr double kBearingSigma = 0.25 / kDegreesPerRadian;  // [rad]
  const double slant_range = fields.distance("target_sr").value_or(std::abs(*depth));
  const Geodetic position = projection_.toGeodetic({*north, *east});
  pending_.emplace_back(UsblFix{*utc_ns, *utc_ns, position.latitude, position.longitude, *depth,
                                hypotenuse(kRangeSigma, kBearingSigma * slant_range)});
  return true;
}

RawAuvWriter::RawAuvWriter(const std::filesystem::path& path, const Geodetic& origin,
                           double magnetic_declination)
    : file_(path), projection_(origin), magnetic_declination_(magnetic_declination) {}

void RawAuvWriter::write(const SensorSample& sample) {
  if (const auto* dvl = std::get_if<DvlSample>(&sample)) writeDvl(*dvl);
  if (const auto* attitude = std::get_if<AttitudeSample>(&sample)) writeAttitude(*attitude);
  if (const auto* fix = std::get_if<UsblFix>(&sample)) writeUsbl(*fix);
  if (const auto* depth = std::get_if<DepthSample>(&sample))
    file_.stream() << "PAROSCI: " << secondsText(depth->utc_ns) << ' ' << numberText(depth->depth) << '\n';
  if (const auto* image = std::get_if<ImageEvent>(&sample)) {
    const std::string time = secondsText(image->utc_ns);
    file_.stream() << "VIS: " << time << " [" << time << "] " << image->file_name.view()
                   << " exp: " << std::llround(image->exposure_s * kMicrosecondsPerSecond) << '\n';
  }
}

void RawAuvWriter::writeDvl(const DvlSample& dvl) {
  std::ostream& out = file_.stream();
  out << "RDI: " << secondsText(dvl.utc_ns) << " alt:" << numberText(dvl.altitude);
  for (std::size_t i = 0; i < 4; ++i) out << " r" << i + 1 << ':' << numberText(dvl.range[i]);
  std::optional<double> heading, pitch, roll, heading_true;
  if (attitude_) {
    const double toMagnetic = attitude_->magnetic ? 0.0 : -magnetic_declination_;
    heading = compassDegrees(attitude_->heading + toMagnetic);
    heading_true = compassDegrees(attitude_->heading + toMagnetic + magnetic_declination_);
    pitch = attitude_->pitch * kDegreesPerRadian;
    roll = attitude_->roll * kDegreesPerRadian;
  }
  out << " h:" << numberText(heading) << " p:" << numberText(pitch) << " r:" << numberText(roll);
  constexpr std::array<const char*, 3> kAxes = {"vx", "vy", "vz"};
  for (Eigen::Index i = 0; i < 3; ++i) {
    out << ' ' << kAxes[static_cast<std::size_t>(i)] << ':';
    out << (dvl.velocity ? numberText((*dvl.velocity)(i)) : numberText({}));
  }
  out << " nx:-9999 ny:-9999 nz:-9999 COG:-9999 SOG:-9999 bt_status:" << (dvl.velocity ? 0 : 1)
      << " h_true:" << numberText(heading_true) << " p_gimbal:-9999 sv: " << numberText(dvl.sound_speed)
      << '\n';
}

void RawAuvWriter::writeAttitude(const AttitudeSample& attitude) {
  attitude_ = attitude;
  const double heading = attitude.heading + (attitude.magnetic ? magnetic_declination_ : 0.0);
  file_.stream() << "PHINS_COMPASS: " << secondsText(attitude.utc_ns)
                 << " r: " << numberText(attitude.roll * kDegreesPerRadian)
                 << " p: " << numberText(attitude.pitch * kDegreesPerRadian)
                 << " h: " << numberText(compassDegrees(heading))
                 << " std_r: -9999 std_p: -9999 std_h: -9999\n";
}

void RawAuvWriter::writeUsbl(const UsblFix& fix) {
  const Eigen::Vector2d north_east = projection_.toLocal({fix.latitude, fix.longitude});
  file_.stream() << "SSBL_FIX: " << secondsText(fix.utc_ns)
                 << " ship_x: -9999 ship_y: -9999 target_x: " << numberText(north_east.x())
                 << " target_y: " << numberText(north_east.y()) << " target_z: " << numberText(fix.depth)
                 << " target_hr: -9999 target_sr: -9999 target_bearing: -9999\n";
}

}  // namespace fathom::io
