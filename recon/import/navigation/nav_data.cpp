#include "recon/import/navigation/nav_data.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>

#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/import/navigation/nav_csv.hpp"

namespace fathom::topside {
namespace {

// Between two rows, what is on the line between them is known; of positions and depth, which change
// steadily, over longer than of attitude and velocity [ns].
constexpr std::int64_t kSteadyGap = 12'000'000'000, kGap = 2'500'000'000;

std::array<std::vector<NavRow> NavData::*, 8> kSeries{&NavData::position, &NavData::local, &NavData::depth,
                                                      &NavData::heading,  &NavData::tilt,  &NavData::altitude,
                                                      &NavData::velocity, &NavData::track};

double seconds(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-9;
}

double wrapped(double angle) {
  return std::remainder(angle, 2 * std::numbers::pi);
}

bool before(const NavRow& row, std::int64_t t) {
  return row.utc_ns < t;
}

// `turns`: the first value is an angle, which jumps by a turn.
std::optional<Eigen::Vector3d> at(const std::vector<NavRow>& rows, std::int64_t t, std::int64_t gap,
                                  bool turns = false) {
  const auto next = std::lower_bound(rows.begin(), rows.end(), t, before);
  if (next != rows.end() && next->utc_ns == t) return next->value;
  if (next == rows.begin() || next == rows.end()) return {};
  const NavRow& last = *(next - 1);
  if (next->utc_ns - last.utc_ns > gap) return {};
  Eigen::Vector3d step = next->value - last.value;
  if (turns) step.x() = wrapped(step.x());
  return last.value + seconds(t - last.utc_ns) / seconds(next->utc_ns - last.utc_ns) * step;
}

// Attitude is asked for at every velocity: where it is not there, neither is the velocity in nav.
std::vector<NavRow> velocitiesInNav(const NavData& data) {
  std::vector<NavRow> out = data.track;
  for (const NavRow& row : data.velocity) {
    const auto heading = at(data.heading, row.utc_ns, kGap, true), tilt = at(data.tilt, row.utc_ns, kGap);
    if (!heading) continue;
    const double roll = tilt ? tilt->x() : 0, pitch = tilt ? tilt->y() : 0;
    out.push_back(
        {row.utc_ns, SE3::fromEuler(roll, pitch, heading->x(), Eigen::Vector3d::Zero()) * row.value});
  }
  std::stable_sort(out.begin(), out.end(),
                   [](const NavRow& a, const NavRow& b) { return a.utc_ns < b.utc_ns; });
  return out;
}

// The integral of the line between the rows.
std::optional<Eigen::Vector3d> movedBetween(const std::vector<NavRow>& rows, std::int64_t from,
                                            std::int64_t to) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  std::int64_t t = from;
  std::optional<Eigen::Vector3d> v = at(rows, from, kGap);
  for (auto row = std::lower_bound(rows.begin(), rows.end(), from, before); v && t < to; ++row) {
    const std::int64_t next = row == rows.end() ? to : std::min(row->utc_ns, to);
    const auto w = at(rows, next, kGap);
    if (!w) return {};
    sum += 0.5 * seconds(next - t) * (*v + *w);
    t = next;
    v = w;
    if (row == rows.end()) break;
  }
  if (!v) return {};
  return sum;
}

// Receivers without a fix say 0 N 0 E, or anything for a moment.
void leaveOutWild(NavData& data) {
  constexpr double kFar = 1e5 / 6.371e6;  // [rad]
  std::vector<NavRow>& rows = data.position;
  std::size_t wild = std::erase_if(rows, [](const NavRow& row) { return row.value.head<2>().isZero(); });
  const auto apart = [&](std::size_t a, std::size_t b) {
    const Eigen::Vector3d step = rows[b].value - rows[a].value;
    return hypotenuse(step.x(), std::cos(rows[a].value.x()) * wrapped(step.y())) > kFar;
  };
  std::vector<NavRow> kept;
  for (std::size_t k = 0; k < rows.size(); ++k)
    if (rows.size() < 3 || (k > 0 && !apart(k - 1, k)) || (k + 1 < rows.size() && !apart(k, k + 1)))
      kept.push_back(rows[k]);
  wild += rows.size() - kept.size();
  rows = std::move(kept);
  if (wild > 0)
    data.assumed.push_back(std::to_string(wild) +
                           " positions at 0 N 0 E or over 100 km from those before and after are left out");
}

bool looksLikeNmea(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::string head(4096, '\0');
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(in.gcount()));
  for (std::size_t k = head.find('$'); k != std::string::npos; k = head.find('$', k + 1)) {
    const std::size_t comma = head.find(',', k);
    if (comma != std::string::npos && comma - k >= 5 && comma - k <= 8 &&
        std::all_of(head.begin() + static_cast<std::ptrdiff_t>(k) + 1,
                    head.begin() + static_cast<std::ptrdiff_t>(comma),
                    [](unsigned char c) { return std::isupper(c) != 0 || std::isdigit(c) != 0; }))
      return true;
  }
  return false;
}

}  // namespace

bool NavData::empty() const {
  return std::all_of(kSeries.begin(), kSeries.end(),
                     [&](const auto series) { return (this->*series).empty(); });
}

NavData readNavFiles(const NavFileOptions& options, std::optional<std::int64_t> about_utc_ns) {
  NavData all;
  for (const std::filesystem::path& file : options.files) {
    if (!std::filesystem::is_regular_file(file)) throw InputError(file.string(), "", "is not there");
    NavData one =
        looksLikeNmea(file) ? readNmea(file, options.declination, about_utc_ns) : readNavCsv(file, options);
    leaveOutWild(one);
    if (one.empty()) throw InputError(file.string(), "", "holds no navigation");
    for (const auto series : kSeries)
      (all.*series).insert((all.*series).end(), (one.*series).begin(), (one.*series).end());
    all.assumed.insert(all.assumed.end(), one.assumed.begin(), one.assumed.end());
  }
  if (!all.position.empty() && !all.local.empty())
    throw InputError(
        options.files.back().string(), "",
        "gives north and east of an unknown place beside latitudes; give one of them, or --nav-crs");
  for (const auto series : kSeries) {
    std::vector<NavRow>& rows = all.*series;
    for (NavRow& row : rows) row.utc_ns += rt::nanoseconds(options.offset);
    std::stable_sort(rows.begin(), rows.end(),
                     [](const NavRow& a, const NavRow& b) { return a.utc_ns < b.utc_ns; });
    rows.erase(std::unique(rows.begin(), rows.end(),
                           [](const NavRow& a, const NavRow& b) { return a.utc_ns == b.utc_ns; }),
               rows.end());
  }
  // Of a wide grid, or of a projection without its name: meshes near the origin keep their digits.
  constexpr double kFar = 5e3, kStep = 1e3;  // [m]
  if (!all.local.empty() && all.local.front().value.head<2>().norm() > kFar) {
    const Eigen::Vector2d less = (all.local.front().value.head<2>() / kStep).array().round() * kStep;
    for (NavRow& row : all.local) row.value.head<2>() -= less;
    all.assumed.push_back("north and east are of a grid that nobody named: less " + decimals(less.x(), 0) +
                          " m north, " + decimals(less.y(), 0) +
                          " m east; give --nav-crs to have them on Earth");
  }
  for (auto* rows : {&all.position, &all.local})
    for (NavRow& row : *rows)
      if (!(row.value.z() > 0)) row.value.z() = options.sigma;
  return all;
}

Geodetic originNear(const Geodetic& place) {
  constexpr double kStep = degreesToRadians(0.01);
  return {std::round(place.latitude / kStep) * kStep, std::round(place.longitude / kStep) * kStep};
}

std::optional<Geodetic> originOf(const NavData& data) {
  if (data.position.empty()) return {};
  return originNear({data.position.front().value.x(), data.position.front().value.y()});
}

std::vector<KnownPose> knownAt(const NavData& data, const Geodetic& origin,
                               const std::vector<std::int64_t>& times) {
  std::vector<NavRow> places = data.local;
  const LocalTransverseMercator projection(origin);
  for (const NavRow& row : data.position) {
    const Eigen::Vector2d p = projection.toLocal({row.value.x(), row.value.y()});
    places.push_back({row.utc_ns, {p.x(), p.y(), row.value.z()}});
  }
  const std::vector<NavRow> velocity = velocitiesInNav(data);
  std::vector<KnownPose> out(times.size());
  for (std::size_t k = 0; k < times.size(); ++k) {
    KnownPose& one = out[k];
    if (const auto p = at(places, times[k], kSteadyGap)) {
      one.north_east = p->head<2>();
      one.sigma = p->z();
    }
    if (const auto d = at(data.depth, times[k], kSteadyGap)) one.depth = d->x();
    if (const auto h = at(data.heading, times[k], kGap, true)) one.heading = wrapped(h->x());
    if (const auto a = at(data.tilt, times[k], kGap)) one.tilt = a->head<2>();
    if (const auto a = at(data.altitude, times[k], kGap)) one.altitude = a->x();
    if (k > 0) one.moved = movedBetween(velocity, times[k - 1], times[k]);
  }
  return out;
}

}  // namespace fathom::topside
