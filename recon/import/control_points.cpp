#include "recon/import/control_points.hpp"

#include <cpl_error.h>
#include <ogr_spatialref.h>
#include <cmath>
#include <map>
#include <numbers>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/import/csv_columns.hpp"
#include "recon/import/projected_places.hpp"

namespace fathom::topside {

ProjectedPlaces::ProjectedPlaces(const std::string& option, const std::string& crs) {
  const CPLErrorHandlerPusher quiet(CPLQuietErrorHandler);
  OGRSpatialReference from, to;
  if (from.SetFromUserInput(crs.c_str()) != OGRERR_NONE || to.importFromEPSG(4326) != OGRERR_NONE ||
      !from.IsProjected())
    throw InputError(option, crs, "is no projected coordinate reference system; give one as EPSG:32755");
  from.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  to.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  transform_.reset(OGRCreateCoordinateTransformation(&from, &to));
  if (!transform_) throw InputError(option, crs, "cannot be turned into latitudes and longitudes");
}

std::optional<Geodetic> ProjectedPlaces::operator()(double east, double north) const {
  const CPLErrorHandlerPusher quiet(CPLQuietErrorHandler);
  if (transform_->Transform(1, &east, &north) == 0) return {};
  return Geodetic{north * kRadiansPerDegree, east * kRadiansPerDegree};
}

void ProjectedPlaces::Destroy::operator()(OGRCoordinateTransformation* t) const {
  OGRCoordinateTransformation::DestroyCT(t);
}

namespace {

// A number that a row must have.
double needed(const CsvColumns& csv, std::size_t row, std::size_t column) {
  const auto value = csv.number(row, column);
  if (!value) csv.fail(row, "has nothing in column " + csv.names()[column]);
  return *value;
}

// A standard deviation, `usual` where the table or the row says none.
double sigmaOf(const CsvColumns& csv, std::size_t row, const std::optional<std::size_t>& column,
               double usual) {
  const double sigma = column ? csv.number(row, *column).value_or(usual) : usual;
  if (!(sigma > 0)) csv.fail(row, "has a standard deviation that is not above zero");
  return sigma;
}

bool checks(const CsvColumns& csv, std::size_t row, const std::optional<std::size_t>& column) {
  const std::string use = column ? csv.text(row, *column) : "";
  if (!use.empty() && use != "control" && use != "check")
    csv.fail(row, "is used for '" + use + "'; give control or check");
  return use == "check";
}

class Reader {
 public:
  explicit Reader(const std::filesystem::path& folder) { control_.folder = folder; }

  void points(const std::string& crs) {
    const std::filesystem::path path = control_.folder / "points.csv";
    if (!std::filesystem::exists(path)) return;
    const CsvColumns csv(path);
    const std::size_t name = csv.required("name");
    const bool on_earth = csv.column("latitude") && csv.column("longitude"),
               projected = !on_earth && csv.column("easting") && csv.column("northing");
    if (projected && crs.empty())
      throw InputError(path.string(), "line 1",
                       "gives eastings and northings; say of which grid: --control-crs EPSG:32755");
    const std::size_t y = csv.required(on_earth    ? "latitude"
                                       : projected ? "northing"
                                                   : "north"),
                      x = csv.required(on_earth    ? "longitude"
                                       : projected ? "easting"
                                                   : "east");
    const auto height = csv.column("height");
    const std::size_t z = height ? *height : csv.required("depth");
    const auto sigma = csv.column("sigma_m"), sigma_depth = csv.column("sigma_depth_m"),
               use = csv.column("use");
    std::optional<ProjectedPlaces> to_earth;
    if (projected) to_earth.emplace("--control-crs", crs);
    for (std::size_t row = 0; row < csv.rows(); ++row) {
      if (number_.contains(csv.text(row, name)))
        csv.fail(row, "names point '" + csv.text(row, name) + "' a second time");
      ControlPoints::Point& point = control_.points[numberOf(csv.text(row, name))];
      const Eigen::Vector3d at(needed(csv, row, y), needed(csv, row, x),
                               (height ? -1 : 1) * needed(csv, row, z));
      if (on_earth)
        point.on_earth = {at.x() * kRadiansPerDegree, at.y() * kRadiansPerDegree};
      else if (projected)
        point.on_earth = (*to_earth)(at.y(), at.x());
      if ((on_earth || projected) &&
          (!point.on_earth || std::abs(point.on_earth->latitude) > 0.5 * std::numbers::pi))
        csv.fail(row, "is not on Earth");
      if (!point.on_earth && at.head<2>().norm() > kFar)
        csv.fail(row, "is of a wide grid; name its columns easting and northing, and give --control-crs");
      point.place = at;
      point.sigma.setConstant(sigmaOf(csv, row, sigma, kSurveyed));
      point.sigma.z() = sigmaOf(csv, row, sigma_depth, point.sigma.x());
      point.check = checks(csv, row, use);
    }
  }

  void marks() {
    const CsvColumns csv(control_.folder / "marks.csv");
    const std::size_t point = csv.required("point"), image = csv.required("image"), u = csv.required("u"),
                      v = csv.required("v");
    const auto sigma = csv.column("sigma_px");
    for (std::size_t row = 0; row < csv.rows(); ++row)
      control_.marks.push_back({numberOf(csv.text(row, point)),
                                csv.text(row, image),
                                {needed(csv, row, u), needed(csv, row, v)},
                                sigmaOf(csv, row, sigma, kMarked),
                                row + 1});
  }

  void bars() {
    const std::filesystem::path path = control_.folder / "scale_bars.csv";
    if (!std::filesystem::exists(path)) return;
    const CsvColumns csv(path);
    const std::size_t from = csv.required("from"), to = csv.required("to"), length = csv.required("length_m");
    const auto sigma = csv.column("sigma_m"), use = csv.column("use");
    for (std::size_t row = 0; row < csv.rows(); ++row) {
      const ControlPoints::Bar bar{known(csv, row, from), known(csv, row, to), needed(csv, row, length),
                                   sigmaOf(csv, row, sigma, kBar), checks(csv, row, use)};
      if (!(bar.length > 0)) csv.fail(row, "has a length that is not above zero");
      if (bar.from == bar.to) csv.fail(row, "joins a point to itself");
      control_.bars.push_back(bar);
    }
  }

  ControlPoints take() {
    std::vector<bool> marked(control_.points.size(), false);
    for (const ControlPoints::Mark& mark : control_.marks) marked[mark.point] = true;
    bool any = !control_.bars.empty();
    for (std::size_t k = 0; k < marked.size(); ++k) any = any || (marked[k] && control_.points[k].place);
    if (!any)
      throw InputError(control_.folder.string(), "",
                       "has no marked point whose place is known, and no scale bar; points.csv gives places, "
                       "scale_bars.csv lengths");
    return std::move(control_);
  }

 private:
  static constexpr double kSurveyed = 0.01, kMarked = 1, kBar = 0.001;  // [m], [px], [m]
  static constexpr double kFar = 1e5;                                   // of nav's origin [m]

  std::uint32_t numberOf(const std::string& name) {
    const auto [at, fresh] = number_.emplace(name, static_cast<std::uint32_t>(control_.points.size()));
    if (fresh) control_.points.emplace_back().name = name;
    return at->second;
  }
  [[nodiscard]] std::uint32_t known(const CsvColumns& csv, std::size_t row, std::size_t column) const {
    const auto found = number_.find(csv.text(row, column));
    if (found == number_.end())
      csv.fail(row, "names point '" + csv.text(row, column) + "', which is marked in no image");
    return found->second;
  }

  ControlPoints control_;
  std::map<std::string, std::uint32_t> number_;
};

}  // namespace

void ControlPoints::placeAbout(const Geodetic& origin) {
  const LocalTransverseMercator projection(origin);
  for (Point& point : points)
    if (point.on_earth) point.place->head<2>() = projection.toLocal(*point.on_earth);
}

std::optional<Geodetic> ControlPoints::firstOnEarth() const {
  for (const Point& point : points)
    if (point.on_earth) return point.on_earth;
  return {};
}

ControlPoints readControlPoints(const std::filesystem::path& folder, const std::string& crs) {
  Reader reader(folder);
  reader.points(crs);
  reader.marks();
  reader.bars();
  return reader.take();
}

std::vector<ControlSighting> sightingsOf(const ControlPoints& control, const PairList& list) {
  struct Image {
    std::uint32_t pair = 0;
    bool left = true;
    int named = 0;  // so many images
  };
  std::map<std::string, Image> images;
  for (std::uint32_t k = 0; k < list.pairs.size(); ++k)
    for (const bool left : {true, false}) {
      const std::string& whole = left ? list.pairs[k].left : list.pairs[k].right;
      const std::string file = std::filesystem::path(whole).filename().string();
      for (const std::string& name : {whole, file}) {
        Image& image = images[name];
        image = {k, left, image.named + 1};
        if (file == whole) break;
      }
    }
  const std::string path = (control.folder / "marks.csv").string();
  std::vector<ControlSighting> out;
  for (const ControlPoints::Mark& mark : control.marks) {
    const auto found = images.find(mark.image);
    const std::string row = "row " + std::to_string(mark.row);
    if (found == images.end())
      throw InputError(path, row, "marks image '" + mark.image + "', which is none of the dive's");
    if (found->second.named > 1)
      throw InputError(path, row,
                       "marks image '" + mark.image + "', as several are named; give its folder too");
    out.push_back({mark.point, found->second.pair, found->second.left, mark.pixel, mark.sigma});
  }
  return out;
}

}  // namespace fathom::topside
