#include "recon/import/navigation/nav_csv.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <map>
#include <numbers>
#include <string_view>

#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/import/csv_columns.hpp"
#include "recon/import/images/name_times.hpp"
#include "recon/import/projected_places.hpp"

namespace fathom::topside {
namespace {

enum class Kind : std::uint8_t { kTime, kDate, kAngle, kLength, kSpeed, kHemisphere };

struct Quantity {
  const char* name;
  Kind kind;
  std::vector<std::string> usual;  // columns' names, without case, separators and units
};

const std::vector<Quantity>& quantities() {
  static const std::vector<Quantity> all{
      {"time",
       Kind::kTime,
       {"time", "timestamp", "datetime", "utc", "utctime", "timeutc", "unixtime", "epoch"}},
      {"date", Kind::kDate, {"date", "utcdate", "dateutc"}},
      {"latitude", Kind::kAngle, {"latitude", "lat"}},
      {"longitude", Kind::kAngle, {"longitude", "lon", "long", "lng"}},
      {"latitude_sign",
       Kind::kHemisphere,
       {"ns", "latns", "latitudens", "latref", "latituderef", "latdir", "latitudedirection",
        "latitudehemisphere"}},
      {"longitude_sign",
       Kind::kHemisphere,
       {"ew", "lonew", "longew", "lngew", "longitudeew", "lonref", "longituderef", "londir",
        "longitudedirection", "longitudehemisphere"}},
      {"north", Kind::kLength, {"north", "northing"}},
      {"east", Kind::kLength, {"east", "easting"}},
      {"sigma",
       Kind::kLength,
       {"sigma", "accuracy", "sigmahorizontal", "positionsigma", "horizontalaccuracy"}},
      {"depth", Kind::kLength, {"depth", "vehicledepth", "pressuredepth"}},
      {"height", Kind::kLength, {"height", "elevation"}},
      {"heading", Kind::kAngle, {"heading", "hdg", "yaw"}},
      {"roll", Kind::kAngle, {"roll"}},
      {"pitch", Kind::kAngle, {"pitch"}},
      {"altitude", Kind::kLength, {"altitude", "alt", "dvlaltitude"}},
      {"forward", Kind::kSpeed, {"forward", "surge", "velocityforward", "velforward"}},
      {"starboard", Kind::kSpeed, {"starboard", "sway", "velocitystarboard", "velstarboard"}},
      {"down", Kind::kSpeed, {"down", "velocitydownbody"}},
      {"velocity_north", Kind::kSpeed, {"velocitynorth", "northvelocity", "velnorth", "vn", "vnorth"}},
      {"velocity_east", Kind::kSpeed, {"velocityeast", "eastvelocity", "veleast", "ve", "veast"}},
      {"velocity_down", Kind::kSpeed, {"velocitydown", "downvelocity", "veldown", "vd", "vdown"}}};
  return all;
}

struct Unit {
  const char* name;
  Kind kind;
  double value;  // of one, in rad, m, m/s; of times in ns
};
constexpr std::array kUnits{Unit{"deg", Kind::kAngle, kRadiansPerDegree},
                            Unit{"degrees", Kind::kAngle, kRadiansPerDegree},
                            Unit{"rad", Kind::kAngle, 1},
                            Unit{"radians", Kind::kAngle, 1},
                            Unit{"m", Kind::kLength, 1},
                            Unit{"metres", Kind::kLength, 1},
                            Unit{"meters", Kind::kLength, 1},
                            Unit{"cm", Kind::kLength, 0.01},
                            Unit{"mm", Kind::kLength, 0.001},
                            Unit{"ft", Kind::kLength, 0.3048},
                            Unit{"feet", Kind::kLength, 0.3048},
                            Unit{"m/s", Kind::kSpeed, 1},
                            Unit{"mps", Kind::kSpeed, 1},
                            Unit{"cm/s", Kind::kSpeed, 0.01},
                            Unit{"mm/s", Kind::kSpeed, 0.001},
                            Unit{"kn", Kind::kSpeed, 1852.0 / 3600},
                            Unit{"knots", Kind::kSpeed, 1852.0 / 3600},
                            Unit{"s", Kind::kTime, 1e9},
                            Unit{"ms", Kind::kTime, 1e6},
                            Unit{"us", Kind::kTime, 1e3},
                            Unit{"ns", Kind::kTime, 1}};

const Unit* unitNamed(const std::string& name, Kind kind) {
  const auto* found = std::find_if(kUnits.begin(), kUnits.end(),
                                   [&](const Unit& u) { return u.kind == kind && name == u.name; });
  return found == kUnits.end() ? nullptr : found;
}

double usualUnit(Kind kind) {
  return kind == Kind::kAngle ? kRadiansPerDegree : 1;
}

struct Column {
  std::size_t index = 0;
  double unit = 1;
  std::optional<NameTime> pattern;  // of a time
};

// "Heading [deg]" and "heading_deg" to heading, deg.
std::pair<std::string, std::string> split(const std::string& column) {
  std::string name, unit;
  bool inside = false;
  for (const char c : column) {
    if (c == '[' || c == '(')
      inside = true;
    else if (c == ']' || c == ')')
      inside = false;
    else
      (inside ? unit : name) += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  const std::size_t last = name.find_last_of("_ ");
  if (unit.empty() && last != std::string::npos &&
      std::any_of(kUnits.begin(), kUnits.end(),
                  [&](const Unit& u) { return name.substr(last + 1) == u.name; })) {
    unit = name.substr(last + 1);
    name.resize(last);
  }
  return {plainName(name), unit};
}

std::map<std::string, Column> named(const CsvColumns& table, const std::string& text) {
  std::map<std::string, Column> out;
  std::size_t at = 0;
  while (at < text.size()) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    const std::string one = text.substr(at, end - at);
    at = end + 1;
    const std::size_t equal = one.find('=');
    const std::string quantity = one.substr(0, equal);
    const auto known = std::find_if(quantities().begin(), quantities().end(),
                                    [&](const Quantity& q) { return quantity == q.name; });
    if (equal == std::string::npos || known == quantities().end()) {
      std::string list;
      for (const Quantity& q : quantities()) list += (list.empty() ? "" : ", ") + std::string(q.name);
      throw InputError("--nav-columns", one, "is not QUANTITY=COLUMN[:UNIT] with one of: " + list);
    }
    const std::size_t colon = one.find(':', equal);
    Column column{
        table.required(one.substr(equal + 1, colon == std::string::npos ? colon : colon - equal - 1)),
        usualUnit(known->kind),
        {}};
    if (known->kind == Kind::kTime) column.unit = 0;
    if (colon != std::string::npos) {
      const std::string unit = one.substr(colon + 1);
      if (known->kind == Kind::kTime && unit.find('%') != std::string::npos)
        column.pattern.emplace(unit);
      else if (const Unit* u = unitNamed(unit, known->kind))
        column.unit = u->value;
      else
        throw InputError("--nav-columns", one, "has a unit that is not known for " + quantity);
    }
    out.insert_or_assign(quantity, column);
  }
  return out;
}

void addUsual(const CsvColumns& table, std::map<std::string, Column>& columns) {
  for (std::size_t index = 0; index < table.names().size(); ++index) {
    const auto [name, unit] = split(table.names()[index]);
    for (const Quantity& q : quantities()) {
      // The unit of time in lat_ns is none.
      const std::string& known = q.kind == Kind::kHemisphere ? plainName(table.names()[index]) : name;
      if (columns.contains(q.name) || std::find(q.usual.begin(), q.usual.end(), known) == q.usual.end() ||
          (q.kind == Kind::kAngle && unit == "ns"))
        continue;
      const Unit* u = unitNamed(unit, q.kind);
      columns[q.name] = {index, u != nullptr ? u->value : q.kind == Kind::kTime ? 0 : usualUnit(q.kind), {}};
    }
  }
}

// Degrees, minutes and seconds, or with a letter, as "23 30.0 S" and "S23°30'": in degrees. None for one
// plain number, and for what is no such angle.
std::optional<double> sexagesimal(const std::string& text) {
  constexpr int kMostNumbers = 3;
  double degrees = 0, unit = 1;
  int numbers = 0;
  bool letter = false, negative = false;
  const char* const end = text.data() + text.size();
  for (const char* at = text.data(); at < end; ++at) {
    const auto c = static_cast<unsigned char>(*at);
    if (std::isdigit(c) != 0) {
      double number = 0;
      at = std::from_chars(at, end, number).ptr - 1;
      degrees += unit * number;
      unit /= 60;
      ++numbers;
    } else if (std::string_view("NnEeSsWw").find(*at) != std::string_view::npos) {
      letter = true;
      negative = negative || std::string_view("SsWw").find(*at) != std::string_view::npos;
    } else if (std::isalpha(c) != 0) {
      return {};
    } else if (c == '-' && numbers == 0) {
      negative = true;
    }
  }
  if (numbers < 1 || numbers > kMostNumbers || (numbers == 1 && !letter)) return {};
  return negative ? -degrees : degrees;
}

class Table {
 public:
  Table(const CsvColumns& table, const NavFileOptions& options) : table_(table) {
    columns_ = named(table, options.columns);
    addUsual(table, columns_);
  }

  [[nodiscard]] bool has(const char* quantity) const { return columns_.contains(quantity); }

  // In rad, m, m/s; none for an empty cell.
  [[nodiscard]] std::optional<double> number(std::size_t row, const char* quantity) const {
    const auto found = columns_.find(quantity);
    if (found == columns_.end()) return {};
    const auto value = table_.number(row, found->second.index);
    if (!value) return {};
    return *value * found->second.unit;
  }

  // The same of a latitude or longitude, with the sign of its hemisphere: of the two in `hemispheres` ("NS")
  // the second is negative.
  [[nodiscard]] std::optional<double> place(std::size_t row, const char* quantity, const char* sign,
                                            const char* hemispheres) const {
    const auto found = columns_.find(quantity), side = columns_.find(sign);
    if (found == columns_.end()) return {};
    const auto degrees = sexagesimal(table_.text(row, found->second.index));
    const auto value = degrees ? std::optional(*degrees * kRadiansPerDegree) : number(row, quantity);
    if (!value || side == columns_.end()) return value;
    const std::string& text = table_.text(row, side->second.index);
    if (text.empty()) return value;
    const auto first = static_cast<char>(std::toupper(static_cast<unsigned char>(text.front())));
    if (first != hemispheres[0] && first != hemispheres[1])
      table_.fail(row, "has '" + text + "' where " + hemispheres[0] + " or " + hemispheres[1] + " should be");
    return first == hemispheres[1] ? -std::abs(*value) : std::abs(*value);
  }

  [[nodiscard]] std::int64_t time(std::size_t row) const {
    const Column& column = columns_.at("time");
    const std::string& text = table_.text(row, column.index);
    if (column.pattern) {
      if (const auto t = column.pattern->of(text)) return *t;
      table_.fail(row, "has a time '" + text + "' that is not of the form given");
    }
    if (column.unit > 0) return table_.time(row, column.index, column.unit);
    if (!has("date")) return table_.time(row, column.index);
    const std::string both = table_.text(row, columns_.at("date").index) + " " + text;
    if (const auto t = CsvColumns::timeOf(both)) return *t;
    table_.fail(row, "has no date and time '" + both + "'");
  }

  [[nodiscard]] std::string about() const {
    std::string text;
    for (const Quantity& q : quantities())
      if (const auto found = columns_.find(q.name); found != columns_.end())
        text += (text.empty() ? "" : ", ") + std::string(q.name) + " (" +
                table_.names()[found->second.index] + ")";
    return text;
  }

 private:
  const CsvColumns& table_;
  std::map<std::string, Column> columns_;
};

// A vehicle is below the surface: what is mostly negative is a height.
void turnHeights(NavData& data) {
  std::vector<double> depths;
  for (const NavRow& row : data.depth) depths.push_back(row.value.x());
  if (!(median(std::move(depths)) < 0)) return;
  for (NavRow& row : data.depth) row.value.x() *= -1;
  data.assumed.emplace_back("depths are negative below the surface");
}

}  // namespace

NavData readNavCsv(const std::filesystem::path& path, const NavFileOptions& options) {
  const CsvColumns csv(path);
  const Table table(csv, options);
  if (!table.has("time"))
    throw InputError(path.string(), "line 1", "has no column of times; name it: --nav-columns time=COLUMN");
  std::optional<ProjectedPlaces> to_geodetic;
  if (!options.crs.empty()) to_geodetic.emplace("--nav-crs", options.crs);
  NavData data;
  data.assumed.push_back("navigation from " + path.filename().string() + ": " + table.about());
  for (std::size_t row = 0; row < csv.rows(); ++row) {
    const std::int64_t t = table.time(row);
    const double sigma = table.number(row, "sigma").value_or(0);
    const auto latitude = table.place(row, "latitude", "latitude_sign", "NS"),
               longitude = table.place(row, "longitude", "longitude_sign", "EW");
    if (latitude && longitude) {
      if (std::abs(*latitude) > 0.5 * std::numbers::pi || std::abs(*longitude) > 2 * std::numbers::pi)
        csv.fail(row, "has a latitude or longitude that is not on Earth; check --nav-columns and its units");
      data.position.push_back({t, {*latitude, std::remainder(*longitude, 2 * std::numbers::pi), sigma}});
    }
    const auto north = table.number(row, "north"), east = table.number(row, "east");
    if (north && east && !(latitude && longitude)) {
      if (!to_geodetic) {
        data.local.push_back({t, {*north, *east, sigma}});
      } else if (const auto place = (*to_geodetic)(*east, *north)) {
        data.position.push_back({t, {place->latitude, place->longitude, sigma}});
      } else {
        csv.fail(row, "has coordinates outside of " + options.crs);
      }
    }
    const auto depth = table.number(row, "depth"), height = table.number(row, "height");
    if (depth || height) data.depth.push_back({t, {depth ? *depth : -*height, 0, 0}});
    if (const auto heading = table.number(row, "heading"))
      data.heading.push_back({t, {*heading + options.declination, 0, 0}});
    const auto roll = table.number(row, "roll"), pitch = table.number(row, "pitch");
    if (roll && pitch) data.tilt.push_back({t, {*roll, *pitch, 0}});
    if (const auto altitude = table.number(row, "altitude"); altitude && *altitude > 0)
      data.altitude.push_back({t, {*altitude, 0, 0}});
    const auto forward = table.number(row, "forward"), starboard = table.number(row, "starboard");
    if (forward && starboard)
      data.velocity.push_back({t, {*forward, *starboard, table.number(row, "down").value_or(0)}});
    const auto to_north = table.number(row, "velocity_north"), to_east = table.number(row, "velocity_east");
    if (to_north && to_east)
      data.track.push_back({t, {*to_north, *to_east, table.number(row, "velocity_down").value_or(0)}});
  }
  if (table.has("depth")) turnHeights(data);
  if (!table.has("forward") && !table.has("velocity_east") && csv.column("u") && csv.column("v")) {
    const std::string why =
        "u and v are left out, as they may be of the Earth's axes or of the body's; say which: --nav-columns "
        "velocity_east=u,velocity_north=v or forward=u,starboard=v";
    if (data.empty()) throw InputError(path.string(), "columns", why);
    data.assumed.push_back(why);
  }
  return data;
}

}  // namespace fathom::topside
