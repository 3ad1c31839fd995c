#include "firmware_if/devices/lcm/health_report.hpp"

#include <acfrlcm/auv_acfr_nav_t.hpp>
#include <algorithm>
#include <cmath>
#include <fathom/health_t.hpp>
#include <fathom/link_t.hpp>
#include <fathom/map_t.hpp>
#include <fathom/pose_t.hpp>
#include <numbers>

#include "firmware_if/mission/log/checked_message.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

std::string nameText(const ShortName& name) {
  return std::string(name.view());
}

template <class List>
void writeCounts(const List& list, std::int32_t& n, std::vector<count_t>& out) {
  n = static_cast<std::int32_t>(list.size());
  for (const NamedCount& count : list) {
    count_t m;
    m.name = nameText(count.name);
    m.value = static_cast<std::int64_t>(count.value);
    out.push_back(m);
  }
}

}  // namespace

LogMessage encodePose(const PoseReport& pose) {
  pose_t m = {};
  m.utc_ns = pose.utc_ns;
  m.latitude = pose.latitude;
  m.longitude = pose.longitude;
  for (int i = 0; i < 3; ++i) {
    m.position[i] = pose.position(i);
    m.velocity[i] = pose.velocity(i);
    m.rates[i] = pose.rates(i);
  }
  m.attitude[0] = pose.attitude.w();
  m.attitude[1] = pose.attitude.x();
  m.attitude[2] = pose.attitude.y();
  m.attitude[3] = pose.attitude.z();
  m.has_altitude = pose.altitude ? 1 : 0;
  m.altitude = pose.altitude.value_or(0.0);
  m.has_sigma = pose.sigma_horizontal ? 1 : 0;
  m.sigma_horizontal = pose.sigma_horizontal.value_or(0.0);
  return {"FATHOM_POSE", encodeChecked(m)};
}

LogMessage encodeAcfrNav(const PoseReport& pose, const std::string& vehicle_name) {
  acfrlcm::auv_acfr_nav_t m = {};
  m.utime = pose.utc_ns / 1000;
  m.latitude = pose.latitude * kDegreesPerRadian;
  m.longitude = pose.longitude * kDegreesPerRadian;
  m.x = pose.position.x();
  m.y = pose.position.y();
  m.depth = pose.position.z();
  // R = Rz(heading) Ry(pitch) Rx(roll).
  const Eigen::Matrix3d R = pose.attitude.normalized().toRotationMatrix();
  m.roll = std::atan2(R(2, 1), R(2, 2));
  m.pitch = std::asin(std::clamp(-R(2, 0), -1.0, 1.0));
  m.heading = std::atan2(R(1, 0), R(0, 0));
  if (m.heading < 0) m.heading += 2 * std::numbers::pi;
  m.vx = pose.velocity.x();
  m.vy = pose.velocity.y();
  m.vz = pose.velocity.z();
  m.rollRate = pose.rates.x();
  m.pitchRate = pose.rates.y();
  m.headingRate = pose.rates.z();
  m.altitude = pose.altitude.value_or(0.0);
  return {vehicle_name + ".ACFR_NAV", encodePlain(m)};
}

LogMessage encodeMap(const MapReport& map) {
  map_t m = {};
  m.utc_ns = map.utc_ns;
  m.pairs = static_cast<std::int64_t>(map.pairs);
  m.keyframes = static_cast<std::int64_t>(map.keyframes);
  m.closures = static_cast<std::int64_t>(map.closures);
  m.area = map.area_m2;
  m.finest_cell = map.finest_cell_m;
  m.coarsest_cell = map.coarsest_cell_m;
  writeCounts(map.counts, m.n_counts, m.counts);
  return {"FATHOM_MAP", encodeChecked(m)};
}

LogMessage encodeLink(const LinkReport& link) {
  link_t m = {};
  m.utc_ns = link.utc_ns;
  m.open = link.open ? 1 : 0;
  m.heard = link.heard_ago_s ? 1 : 0;
  m.heard_ago = link.heard_ago_s.value_or(0.0);
  m.rate = link.rate_bps;
  m.share_told = link.share_on_ship;
  m.frames_sent = static_cast<std::int64_t>(link.frames_sent);
  m.frames_received = static_cast<std::int64_t>(link.frames_received);
  m.bytes_sent = static_cast<std::int64_t>(link.bytes_sent);
  m.bytes_received = static_cast<std::int64_t>(link.bytes_received);
  writeCounts(link.counts, m.n_counts, m.counts);
  return {"FATHOM_LINK", encodeChecked(m)};
}

LogMessage encodeHealth(const HealthReport& health) {
  health_t m = {};
  m.utc_ns = health.utc_ns;
  m.soft = health.soft ? 1 : 0;
  m.degradation = static_cast<std::int8_t>(health.degradation);
  m.uptime = health.uptime_s;
  m.restarts = static_cast<std::int64_t>(health.restarts);
  m.clock_steps = static_cast<std::int64_t>(health.clock_steps);
  m.resident_mib = health.resident_mib;
  m.budget_mib = health.budget_mib;
  const std::optional<double>* system[] = {&health.disk_free_mib, &health.temperature_c, &health.load};
  for (int i = 0; i < 3; ++i) {
    m.has_system[i] = system[i]->has_value() ? 1 : 0;
    m.system[i] = system[i]->value_or(0.0);
  }
  m.n_stages = static_cast<std::int32_t>(health.stages.size());
  for (const StageReport& stage : health.stages) {
    stage_t s;
    s.name = nameText(stage.name);
    s.runs = static_cast<std::int64_t>(stage.runs);
    s.deadline_misses = static_cast<std::int64_t>(stage.deadline_misses);
    s.last_ms = stage.last_ms;
    s.p50_ms = stage.p50_ms;
    s.p99_ms = stage.p99_ms;
    s.max_ms = stage.max_ms;
    m.stages.push_back(s);
  }
  m.n_fills = static_cast<std::int32_t>(health.fills.size());
  for (const FillReport& fill : health.fills) {
    fill_t f;
    f.name = nameText(fill.name);
    f.used = fill.used;
    f.high_water = fill.high_water;
    f.capacity = fill.capacity;
    f.refused = static_cast<std::int64_t>(fill.refused);
    m.fills.push_back(f);
  }
  writeCounts(health.drops, m.n_drops, m.drops);
  m.n_devices = static_cast<std::int32_t>(health.devices.size());
  for (const DeviceReport& device : health.devices) {
    device_t d;
    d.name = nameText(device.name);
    d.open = device.open ? 1 : 0;
    d.has_data = device.silent_s ? 1 : 0;
    d.silent = device.silent_s.value_or(0.0);
    d.samples = static_cast<std::int64_t>(device.samples);
    d.disconnects = static_cast<std::int64_t>(device.disconnects);
    m.devices.push_back(d);
  }
  m.n_parts = static_cast<std::int32_t>(health.parts.size());
  for (const PartOfProgram& part : health.parts) {
    fathom::part_t p = {};
    p.name = part.name.view();
    p.state = part.state.view();
    p.reason = part.reason.view();
    m.parts.push_back(p);
  }
  return {"FATHOM_HEALTH", encodeChecked(m)};
}

}  // namespace fathom::io
