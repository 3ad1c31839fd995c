#include "recon/topside/report/control_report.hpp"

#include <cmath>

#include "realtime/base/text.hpp"

namespace fathom::topside {
namespace {

using Json = nlohmann::ordered_json;
using web::Fields;

const char* useOf(const ControlResult::Point& p) {
  return !p.surveyed ? "tie" : p.check ? "check" : p.left_out ? "left out" : "control";
}

std::string millimetres(double metres) {
  return decimals(1000 * metres, 1);
}

// Of points of one use that images see: root mean squares of what they are off and of what is claimed [m].
struct Spread {
  int points = 0;
  double off = 0, claimed = 0, worst = 0;
  std::string worst_name;
};
Spread spreadOf(const ControlResult& control, bool check) {
  Spread out;
  for (const ControlResult::Point& p : control.points) {
    if (!p.surveyed || p.left_out || p.check != check || p.marks == 0) continue;
    ++out.points;
    out.off += p.off.squaredNorm();
    out.claimed += p.sigma.squaredNorm();
    if (p.off.norm() >= out.worst) out.worst = p.off.norm(), out.worst_name = p.name;
  }
  if (out.points == 0) return out;
  out.off = std::sqrt(out.off / out.points);
  out.claimed = std::sqrt(out.claimed / out.points);
  return out;
}

Fields pointFields(const ControlResult::Point& p) {
  Fields out = {{"name", p.name, "point"},
                {"use", useOf(p), "use"},
                {"marks", p.marks, "marks"},
                {"marks_left_out", p.marks_left_out, "left out"},
                {"north_east_down_m", web::jsonOf(p.place)},
                {"sigma_m", web::jsonOf(p.sigma)},
                {"pixel_rms", p.pixel_rms, "off in images [px]", 2}};
  if (!p.surveyed) return out;
  out.emplace_back("off_m", web::jsonOf(p.off));
  constexpr const char* kAxes[] = {"north [mm]", "east [mm]", "down [mm]"};
  for (int i = 0; i < 3; ++i) out.push_back(web::onPage(kAxes[i], millimetres(p.off(i))));
  for (int i = 0; i < 3; ++i)
    out.push_back(web::onPage(std::string("sigma ") + kAxes[i], millimetres(p.sigma(i))));
  return out;
}

Fields barFields(const ControlResult::Bar& b) {
  return {{"from", b.from, "scale bar from"},
          {"to", b.to, "to"},
          {"use", b.check ? "check" : "control", "use"},
          {"length_m", b.length, "length [m]", 4},
          {"sigma_m", b.sigma, "its sigma [mm]", 1, 1000},
          {"off_m", b.off, "in the model, longer by [mm]", 1, 1000}};
}

std::vector<Fields> barRecords(const ControlResult& control) {
  std::vector<Fields> out;
  for (const ControlResult::Bar& bar : control.bars) out.push_back(barFields(bar));
  return out;
}

}  // namespace

Json controlJson(const ControlResult& control) {
  if (control.points.empty()) return nullptr;
  std::vector<Fields> points;
  for (const ControlResult::Point& p : control.points) points.push_back(pointFields(p));
  const auto ifScaled = [&](double number) { return control.scaled ? Json(number) : Json(); };
  return web::jsonOf({{"converged", control.converged},
                      {"scale", ifScaled(control.scale)},
                      {"scale_sigma", ifScaled(control.scale_sigma)},
                      {"points", web::jsonOf(points)},
                      {"bars", web::jsonOf(barRecords(control))}});
}

void addControl(web::ReportPage& report, const ControlResult& control) {
  if (control.points.empty()) return;
  report.section("Control points");
  report.text(
      "Where the images have each point, less where it was surveyed. Control points hold the model; check "
      "points have no part in where it is, and show how good it is. Standard deviations are claimed: of "
      "control "
      "points as the model has them, of check points with the survey's own.");
  std::vector<Fields> points;
  for (const ControlResult::Point& p : control.points)
    if (p.surveyed) points.push_back(pointFields(p));
  web::addTable(report, points);
  web::addTable(report, barRecords(control));
  if (control.scaled)
    report.table({}, {{"lengths of the images were multiplied by",
                       web::plusMinus(control.scale, control.scale_sigma, 5)}});
}

std::optional<std::string> controlSentence(const ControlResult& control) {
  const Spread check = spreadOf(control, true), held = spreadOf(control, false);
  const Spread& best = check.points > 0 ? check : held;
  if (best.points == 0) return {};
  return std::to_string(best.points) + (check.points > 0 ? " check points" : " control points") + " are " +
         millimetres(best.off) + " mm rms off (claimed " + millimetres(best.claimed) + "), the farthest, " +
         best.worst_name + ", " + millimetres(best.worst) + " mm.";
}

std::vector<std::string> controlWarnings(const ControlResult& control) {
  constexpr double kSigmas = 4, kMatters = 0.002;  // of scale [1]
  std::vector<std::string> out;
  for (const ControlResult::Point& p : control.points) {
    const std::string name = std::string(p.check ? "Check" : "Control") + " point " + p.name;
    if (p.surveyed && p.marks + p.marks_left_out == 0)
      out.push_back(name + " is marked in no image that could be placed.");
    else if (p.left_out)
      out.push_back(name + " contradicts the others by " + decimals(p.off.norm(), 2) +
                    " m and has no part in the result: look at its coordinates and its name.");
    else if (p.marks == 0)
      out.push_back((p.surveyed ? name : "Point " + p.name) +
                    " has no part in the result: all its marks contradict the rest.");
    else if (p.marks_left_out > 0)
      out.push_back(std::to_string(p.marks_left_out) + " of " + std::to_string(p.marks + p.marks_left_out) +
                    " marks of " + p.name + " contradict the rest and were left out.");
    if (p.check && p.marks > 0 && (p.off.array().abs() > kSigmas * p.sigma.array()).any())
      out.push_back(name + " is " + decimals(p.off.norm(), 3) + " m off, where " +
                    decimals(p.sigma.norm(), 3) + " m is claimed.");
  }
  if (const double off = control.scale - 1;
      control.scaled && std::abs(off) > std::max(kMatters, kSigmas * control.scale_sigma))
    out.push_back("By control points and scale bars the images measured all lengths " +
                  decimals(100 * std::abs(off), 2) + " percent too " + (off > 0 ? "short" : "long") +
                  " (standard deviation " + decimals(100 * control.scale_sigma, 2) +
                  "), which was taken out. Calibrate the baseline again.");
  return out;
}

}  // namespace fathom::topside
