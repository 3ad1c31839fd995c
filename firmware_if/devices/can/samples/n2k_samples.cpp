#include "firmware_if/devices/can/samples/n2k_samples.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <stdexcept>
#include <utility>

#include "realtime/base/units.hpp"
#include "recon/geometry/sea_water.hpp"

namespace fathom::io {
namespace {

// Interpolates an angle in the direction of the smaller turn.
double interpolateAngle(double from, double to, double fraction) {
  return std::remainder(from + fraction * std::remainder(to - from, 2 * std::numbers::pi),
                        2 * std::numbers::pi);
}

std::optional<std::string_view> textOf(const N2kMessage& message, std::string_view field) {
  for (const N2kField& f : message.present()) {
    if (field == f.name && f.text != nullptr) return f.text;
  }
  return std::nullopt;
}

std::optional<std::uint8_t> sequenceId(const N2kMessage& message) {
  const auto value = message.number("sid");
  return value ? std::optional(static_cast<std::uint8_t>(*value)) : std::nullopt;
}

std::optional<double> fresh(const std::optional<HeldNumber>& held, std::int64_t utc_ns,
                            std::int64_t holds_s) {
  return held && utc_ns - held->utc_ns <= holds_s * kSecond_ns ? std::optional(held->value) : std::nullopt;
}

// [rad] north and east, where the message has a place on the Earth.
std::optional<std::array<double, 2>> placeOf(const N2kMessage& message) {
  const auto latitude = message.number("latitude_deg"), longitude = message.number("longitude_deg");
  if (!latitude || !longitude || std::abs(*latitude) > 90 || std::abs(*longitude) > 180) return std::nullopt;
  return std::array{*latitude * kRadiansPerDegree, *longitude * kRadiansPerDegree};
}

double inFullCircle(double angle) {
  const double turned = std::remainder(angle, 2 * std::numbers::pi);
  return turned < 0 ? turned + 2 * std::numbers::pi : turned;
}

}  // namespace

bool AttitudePairing::sameInstant(const Heading& heading, const Tilt& tilt) const noexcept {
  return tilt_sid_moves_ && heading_sid_moves_ && heading.sid && heading.sid == tilt.sid &&
         heading.source == tilt.source && std::abs(heading.utc_ns - tilt.utc_ns) <= max_gap_ns_;
}

void AttitudePairing::give(const Heading& heading, std::int64_t utc_ns, double roll, double pitch) noexcept {
  if (last_given_ns_ && utc_ns <= *last_given_ns_) {
    ++unpaired_;
    return;
  }
  last_given_ns_ = utc_ns;
  out_[out_count_++] = {utc_ns, roll, pitch, heading.heading, heading.magnetic};
}

std::span<const AttitudeSample> AttitudePairing::add(const Heading& heading) noexcept {
  out_count_ = 0;
  heading_sid_moves_ = heading.sid && last_heading_sid_ && heading.sid != last_heading_sid_;
  last_heading_sid_ = heading.sid;
  if (tilt_ && sameInstant(heading, *tilt_)) {
    unpaired_ += waiting_count_;
    waiting_count_ = 0;
    give(heading, std::min(heading.utc_ns, tilt_->utc_ns), tilt_->roll, tilt_->pitch);
    return {out_.data(), out_count_};
  }
  if (waiting_count_ == kWaiting) {
    ++unpaired_;
    std::shift_left(waiting_.begin(), waiting_.end(), 1);
    --waiting_count_;
  }
  waiting_[waiting_count_++] = heading;
  return {};
}

std::span<const AttitudeSample> AttitudePairing::add(const Tilt& tilt) noexcept {
  out_count_ = 0;
  tilt_sid_moves_ = tilt.sid && tilt_ && tilt.sid != tilt_->sid;
  for (std::size_t i = 0; i < waiting_count_; ++i) {
    const Heading& heading = waiting_[i];
    if (sameInstant(heading, tilt)) {
      give(heading, std::min(heading.utc_ns, tilt.utc_ns), tilt.roll, tilt.pitch);
    } else if (heading.utc_ns == tilt.utc_ns) {
      give(heading, heading.utc_ns, tilt.roll, tilt.pitch);
    } else if (tilt_ && tilt_->utc_ns <= heading.utc_ns && heading.utc_ns < tilt.utc_ns &&
               tilt.utc_ns - tilt_->utc_ns <= max_gap_ns_) {
      const double fraction = static_cast<double>(heading.utc_ns - tilt_->utc_ns) /
                              static_cast<double>(tilt.utc_ns - tilt_->utc_ns);
      give(heading, heading.utc_ns, interpolateAngle(tilt_->roll, tilt.roll, fraction),
           interpolateAngle(tilt_->pitch, tilt.pitch, fraction));
    } else {
      ++unpaired_;
    }
  }
  waiting_count_ = 0;
  tilt_ = tilt;
  return {out_.data(), out_count_};
}

void N2kSamples::Config::validate() const {
  const auto need = [](bool good, const char* what) {
    if (!good) throw std::invalid_argument(what);
  };
  need(switch_after_s > 0, "switch_after_s must be positive");
  need(attitude_gap_s > 0, "attitude_gap_s must be positive");
  need(surface_pressure_pa >= 0, "surface_pressure_pa must not be negative");
  need(std::abs(latitude) <= std::numbers::pi / 2, "latitude must be within 90 degrees");
  need(!water_density || *water_density > 0, "water_density must be positive");
  need(gps_range_sigma_m > 0, "gps_range_sigma_m must be positive");
}

N2kSamples::N2kSamples(const Config& config) : config_(config) {
  config_.validate();
  const auto ns = [](double s) { return static_cast<std::int64_t>(s * static_cast<double>(kSecond_ns)); };
  const std::int64_t silence = ns(config_.switch_after_s);
  heading_ = {config_.heading_source, silence};
  tilt_ = {config_.attitude_source, silence};
  gyro_ = {config_.gyro_source, silence};
  depth_ = {config_.depth_source, silence};
  battery_ = {config_.battery_source, silence};
  gps_ = {config_.gps_source, silence};
  water_ = {config_.water_source, silence};
  pairing_ = AttitudePairing(ns(config_.attitude_gap_s));
  if (config_.battery_instance) battery_instance_ = *config_.battery_instance;
}

N2kSamples::Counts N2kSamples::counts() const noexcept {
  Counts out = counts_;
  out.unpaired_headings = pairing_.unpaired();
  out.source_changes = heading_.changes() + tilt_.changes() + gyro_.changes() + depth_.changes() +
                       battery_.changes() + gps_.changes() + water_.changes();
  return out;
}

bool N2kSamples::accepted(SourceSelection& source, const N2kMessage& message, std::int64_t utc_ns) noexcept {
  if (source.accepts(message.id.source, utc_ns)) return true;
  ++counts_.other_sources;
  return false;
}

std::span<const SensorSample> N2kSamples::add(const N2kMessage& message) noexcept {
  out_count_ = 0;
  if (!message.utc_ns) return {};
  const std::int64_t utc_ns = *message.utc_ns;
  using Handle = void (N2kSamples::*)(const N2kMessage&, std::int64_t) noexcept;
  static constexpr std::pair<std::uint32_t, Handle> kHandles[] = {
      {127250, &N2kSamples::addHeading},    {127257, &N2kSamples::addTilt},
      {127251, &N2kSamples::addTurn},       {130314, &N2kSamples::addPressure},
      {128267, &N2kSamples::addWaterDepth}, {127508, &N2kSamples::addBattery},
      {127506, &N2kSamples::addCharge},     {129029, &N2kSamples::addGnss},
      {129025, &N2kSamples::addPosition},   {130312, &N2kSamples::addWater},
      {130316, &N2kSamples::addWater},      {130321, &N2kSamples::addWater}};
  for (const auto& [pgn, handle] : kHandles)
    if (message.id.pgn == pgn) (this->*handle)(message, utc_ns);
  counts_.samples += out_count_;
  return {out_.data(), out_count_};
}

void N2kSamples::addHeading(const N2kMessage& message, std::int64_t utc_ns) noexcept {
  if (!accepted(heading_, message, utc_ns)) return;
  const auto reading = message.number("heading_rad");
  const auto reference = textOf(message, "reference");
  if (!reading || !reference) return incomplete();
  AttitudePairing::Heading heading{utc_ns, message.id.source, sequenceId(message), *reading,
                                   *reference == "magnetic"};
  if (heading.magnetic) {
    heading.heading += message.number("deviation_rad").value_or(0);
    const auto variation = message.number("variation_rad");
    if (config_.message_variation && variation) {
      heading.heading += *variation;
      heading.magnetic = false;
    }
  }
  heading.heading = inFullCircle(heading.heading);
  for (const AttitudeSample& sample : pairing_.add(heading)) give(sample);
}

void N2kSamples::addTilt(const N2kMessage& message, std::int64_t utc_ns) noexcept {
  if (!accepted(tilt_, message, utc_ns)) return;
  const auto roll = message.number("roll_rad"), pitch = message.number("pitch_rad");
  if (!roll || !pitch) return incomplete();
  for (const AttitudeSample& sample :
       pairing_.add(AttitudePairing::Tilt{utc_ns, message.id.source, sequenceId(message), *roll, *pitch}))
    give(sample);
}

void N2kSamples::addTurn(const N2kMessage& message, std::int64_t utc_ns) noexcept {
  if (!accepted(gyro_, message, utc_ns)) return;
  const auto rate = message.number("rate_of_turn_radps");
  if (!rate) return incomplete();
  give(GyroSample{utc_ns, std::nullopt, *rate});
}

void N2kSamples::addDepth(double depth, std::int64_t utc_ns) noexcept {
  last_depth_ = {depth, utc_ns};
  give(DepthSample{utc_ns, depth});
}

void N2kSamples::addPressure(const N2kMessage& message, std::int64_t utc_ns) noexcept {
  if (config_.depth_from != DepthFrom::kPressure || textOf(message, "source") != "water") return;
  if (!accepted(depth_, message, utc_ns)) return;
  const auto pressure = message.number("pressure_pa");
  if (!pressure) return incomplete();
  const double above = *pressure - config_.surface_pressure_pa;
  addDepth(config_.water_density ? depthFromPressure(above, config_.latitude, *config_.water_density)
                                 : depthFromPressure(above, config_.latitude),
           utc_ns);
}

void N2kSamples::addWaterDepth(const N2kMessage& message, std::int64_t utc_ns) noexcept {
  if (config_.depth_from == DepthFrom::kPressure || !accepted(depth_, message, utc_ns)) return;
  const auto depth = message.number(config_.depth_from == DepthFrom::kDepth ? "depth_m" : "offset_m");
  // A negative offset is measured to the keel: it says nothing about the surface.
  if (!depth || *depth < 0) return incomplete();
  addDepth(*depth, utc_ns);
}

bool N2kSamples::isOurBattery(const N2kMessage& message) noexcept {
  const auto instance = message.number("instance");
  if (instance && !battery_instance_) battery_instance_ = instance;
  return instance && instance == battery_instance_;
}

void N2kSamples::addBattery(const N2kMessage& message, std::int64_t utc_ns) noexcept {
  if (!accepted(battery_, message, utc_ns) || !isOurBattery(message)) return;
  BatterySample sample;
  sample.utc_ns = utc_ns;
  sample.voltage = message.number("voltage_v");
  if (const auto into = message.number("current_a")) sample.current = -*into;
  sample.charge = fresh(charge_, utc_ns, kChargeHolds_s);
  if (!sample.voltage && !sample.current && !sample.charge) return incomplete();
  last_battery_ns_ = utc_ns;
  give(sample);
}

void N2kSamples::addCharge(const N2kMessage& message, std::int64_t utc_ns) noexcept {
  if (textOf(message, "dc_type").value_or("battery") != "battery") return;
  if (!accepted(battery_, message, utc_ns) || !isOurBattery(message)) return;
  const auto percent = message.number("state_of_charge_percent");
  if (!percent || *percent > 100) return incomplete();
  const double charge = *percent / 100;
  charge_ = {charge, utc_ns};
  // Else the next 127508 carries it.
  if (!last_battery_ns_ || utc_ns - *last_battery_ns_ > kChargeHolds_s * kSecond_ns) {
    BatterySample sample;
    sample.utc_ns = utc_ns;
    sample.charge = charge;
    give(sample);
  }
}

void N2kSamples::addGnss(const N2kMessage& message, std::int64_t utc_ns) noexcept {
  const auto method = textOf(message, "method");
  const bool measured =
      method && *method != "none" && *method != "estimated" && *method != "manual" && *method != "simulated";
  // An address that only repeats or estimates positions is not taken for a receiver.
  if (!measured) {
    if (gps_.is(message.id.source)) hdop_.reset();
    return incomplete();
  }
  if (!accepted(gps_, message, utc_ns)) return;
  const auto place = placeOf(message);
  const auto hdop = message.number("hdop");
  if (!place || !hdop || *hdop <= 0) {
    hdop_.reset();
    return incomplete();
  }
  hdop_ = {*hdop, utc_ns};
  give(GpsFix{utc_ns, (*place)[0], (*place)[1], *hdop * config_.gps_range_sigma_m});
}

void N2kSamples::addPosition(const N2kMessage& message, std::int64_t utc_ns) noexcept {
  const auto hdop = fresh(hdop_, utc_ns, kHdopHolds_s);
  if (!hdop) return incomplete();
  if (!accepted(gps_, message, utc_ns)) return;
  const auto place = placeOf(message);
  if (!place) return incomplete();
  give(GpsFix{utc_ns, (*place)[0], (*place)[1], *hdop * config_.gps_range_sigma_m});
}

void N2kSamples::addWater(const N2kMessage& message, std::int64_t utc_ns) noexcept {
  const bool station = message.id.pgn == 130321;
  if (!station && textOf(message, "source") != "sea") return;
  if (!accepted(water_, message, utc_ns)) return;
  if (const auto salinity = message.number("salinity_ppt")) salinity_ = {*salinity, utc_ns};
  WaterSample sample;
  sample.utc_ns = utc_ns;
  sample.temperature = message.number(station ? "water_temperature_c" : "temperature_c");
  if (!sample.temperature) return incomplete();
  auto salinity = fresh(salinity_, utc_ns, kWaterHolds_s);
  if (!salinity) salinity = config_.salinity_psu;
  const auto depth = fresh(last_depth_, utc_ns, kWaterHolds_s);
  if (salinity && depth) {
    const double speed = soundSpeed(*sample.temperature, *salinity, std::max(*depth, 0.0));
    if (std::isfinite(speed)) sample.sound_speed = speed;
  }
  give(sample);
}

}  // namespace fathom::io
