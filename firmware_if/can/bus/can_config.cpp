#include "firmware_if/can/bus/can_config.hpp"

#include <array>
#include <optional>
#include <type_traits>

namespace fathom::io {
namespace {

constexpr std::int64_t kLastAddress = 251;  // 252 to 255 are reserved

// -1 stands for none.
std::optional<std::uint8_t> smallInteger(const ConfigTable& table, const char* key,
                                         std::optional<std::uint8_t> fallback, std::int64_t max) {
  const std::int64_t value = table.integer(key, fallback ? *fallback : -1, -1, max);
  return value < 0 ? std::nullopt : std::optional(static_cast<std::uint8_t>(value));
}

// 0 stands for none.
std::optional<double> positive(const ConfigTable& table, const char* key, std::optional<double> fallback,
                               double max) {
  const double value = table.number(key, fallback.value_or(0), 0, max);
  return value > 0 ? std::optional(value) : std::nullopt;
}

void readSources(const ConfigTable& table, N2kSamples::Config& samples) {
  const auto address = [&](const char* key, std::optional<std::uint8_t>& value) {
    value = smallInteger(table, key, value, kLastAddress);
  };
  address("heading_address", samples.heading_source);
  address("attitude_address", samples.attitude_source);
  address("gyro_address", samples.gyro_source);
  address("depth_address", samples.depth_source);
  address("battery_address", samples.battery_source);
  address("gps_address", samples.gps_source);
  address("water_address", samples.water_source);
  samples.switch_after_s = table.number("switch_after_s", samples.switch_after_s, 0.1, 1e6);
}

void readSender(const ConfigTable& table, CanConfig& can) {
  CanSender::Config& sender = can.sender;
  can.send = table.boolean("enabled", can.send);
  const auto integer = [&](const char* key, auto& value, std::int64_t min, std::int64_t max) {
    value = static_cast<std::remove_reference_t<decltype(value)>>(table.integer(key, value, min, max));
  };
  integer("address", sender.address, 0, kLastAddress);
  integer("unique_number", sender.name.unique_number, 0, 0x1FFFFF);
  integer("manufacturer_code", sender.name.manufacturer_code, 0, 2046);
  integer("device_instance", sender.name.device_instance, 0, 255);
  integer("status_pgn", sender.status_pgn, CanSender::kFirstStatusPgn, CanSender::kLastStatusPgn);
  const auto period = [&](const char* key, double& value) {
    value = table.number(key, value, 0, 3600);
    if (value != 0 && value < 0.1) table.fail(key, "must be 0 (never) or 0.1 to 3600 s");
  };
  period("position_period_s", sender.position_period_s);
  period("fix_period_s", sender.fix_period_s);
  period("depth_period_s", sender.depth_period_s);
  period("status_period_s", sender.status_period_s);
  sender.frames_per_s = table.number("frames_per_s", sender.frames_per_s, 1, 1000);
}

}  // namespace

CanConfig readCanConfig(const ConfigTable& table, CanConfig defaults) {
  CanConfig out = std::move(defaults);
  out.interface = table.text("interface", out.interface);
  N2kSamples::Config& samples = out.samples;
  readSources(table, samples);
  samples.attitude_gap_s = table.number("attitude_gap_s", samples.attitude_gap_s, 0.01, 2);
  samples.message_variation = table.choice("variation", samples.message_variation ? "message" : "mission",
                                           {"mission", "message"}) == "message";
  constexpr std::array kDepthSources = {"pressure", "depth", "offset"};
  const std::string depth =
      table.choice("depth_source", kDepthSources[static_cast<std::size_t>(samples.depth_from)],
                   {"pressure", "depth", "offset"});
  for (std::size_t i = 0; i < kDepthSources.size(); ++i) {
    if (depth == kDepthSources[i]) samples.depth_from = static_cast<N2kSamples::DepthFrom>(i);
  }
  samples.surface_pressure_pa = table.number("surface_pressure_pa", samples.surface_pressure_pa, 0, 120000);
  samples.water_density = positive(table, "water_density_kgpm3", samples.water_density, 1200);
  if (samples.water_density && *samples.water_density < 900)
    table.fail("water_density_kgpm3", "must be 0 (standard sea water) or 900 to 1200");
  samples.battery_instance = smallInteger(table, "battery_instance", samples.battery_instance, 252);
  samples.gps_range_sigma_m = table.number("gps_range_sigma_m", samples.gps_range_sigma_m, 0.01, 100);
  samples.salinity_psu = positive(table, "salinity_psu", samples.salinity_psu, 50);
  readSender(table.table("send"), out);
  return out;
}

}  // namespace fathom::io
