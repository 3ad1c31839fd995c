#include "firmware_if/devices/can/n2k_definitions.hpp"

#include <algorithm>
#include <array>

namespace fathom::io {
namespace {

using Field = N2kFieldSpec;

// Kinds of fields by resolution. Angles: 0.0001 rad. Temperatures come in kelvin and leave in degrees
// Celsius.
constexpr Field integer(const char* name, std::uint16_t bit, std::uint8_t bits) {
  return {name, bit, bits, N2kFieldKind::kUnsigned};
}
constexpr Field unsignedPer(const char* name, std::uint16_t bit, std::uint8_t bits, double divide) {
  return {name, bit, bits, N2kFieldKind::kUnsigned, 1, divide};
}
constexpr Field unsignedTimes(const char* name, std::uint16_t bit, std::uint8_t bits, double multiply) {
  return {name, bit, bits, N2kFieldKind::kUnsigned, multiply};
}
constexpr Field signedPer(const char* name, std::uint16_t bit, std::uint8_t bits, double divide) {
  return {name, bit, bits, N2kFieldKind::kSigned, 1, divide};
}
constexpr Field celsius(const char* name, std::uint16_t bit, std::uint8_t bits, double per_kelvin) {
  constexpr double kFreezingHundredths = 27315;  // of a kelvin: an integer, so that the sum stays exact
  return {name, bit, bits, N2kFieldKind::kUnsigned, 1, per_kelvin, -kFreezingHundredths * per_kelvin / 100};
}
constexpr Field floating(const char* name, std::uint16_t bit) {
  return {name, bit, 32, N2kFieldKind::kFloat};
}
constexpr Field named(const char* name, std::uint16_t bit, std::uint8_t bits,
                      std::span<const char* const> names) {
  return {name, bit, bits, N2kFieldKind::kName, 1, 1, 0, names};
}
constexpr Field sidField(std::uint16_t bit = 0) {
  return integer("sid", bit, 8);
}

constexpr std::array kNorth = {"true", "magnetic"};
constexpr std::array kWind = {"true_north", "magnetic_north", "apparent", "true_boat", "true_water"};
constexpr std::array kWaterSpeed = {"paddle_wheel", "pitot_tube", "doppler", "ultrasonic", "electromagnetic"};
constexpr std::array kTemperature = {"sea",
                                     "outside",
                                     "inside",
                                     "engine_room",
                                     "main_cabin",
                                     "live_well",
                                     "bait_well",
                                     "refrigeration",
                                     "heating_system",
                                     "dew_point",
                                     "apparent_wind_chill",
                                     "theoretical_wind_chill",
                                     "heat_index",
                                     "freezer",
                                     "exhaust_gas",
                                     "shaft_seal"};
constexpr std::array kPressure = {"atmospheric",       "water",     "steam",
                                  "compressed_air",    "hydraulic", "filter",
                                  "altimeter_setting", "oil",       "fuel"};
constexpr std::array kDcType = {"battery", "alternator", "convertor", "solar_cell", "wind_generator"};
constexpr std::array kGnssMethod = {"none",      "gnss",      "dgnss",  "precise",  "rtk_fixed",
                                    "rtk_float", "estimated", "manual", "simulated"};

constexpr double kAngle = 1e4;       // per rad
constexpr double kCentimetre = 100;  // per m, and per m/s
constexpr double kMillimetre = 1e3;
constexpr double kClock = 1e4;      // per s since midnight
constexpr double kDegree7 = 1e7;    // per degree, 32 bits
constexpr double kDegree16 = 1e16;  // per degree, 64 bits
constexpr double kTurn = 32e6;      // per rad/s: 2^-5 urad/s

constexpr std::array kSystemTime = {sidField(), integer("days_since_1970", 16, 16),
                                    unsignedPer("time_of_day_s", 32, 32, kClock)};
constexpr std::array kRudder = {integer("instance", 0, 8), signedPer("angle_order_rad", 16, 16, kAngle),
                                signedPer("position_rad", 32, 16, kAngle)};
constexpr std::array kHeading = {
    sidField(), unsignedPer("heading_rad", 8, 16, kAngle), signedPer("deviation_rad", 24, 16, kAngle),
    signedPer("variation_rad", 40, 16, kAngle), named("reference", 56, 2, kNorth)};
constexpr std::array kRateOfTurn = {sidField(), signedPer("rate_of_turn_radps", 8, 32, kTurn)};
constexpr std::array kAttitude = {sidField(), signedPer("yaw_rad", 8, 16, kAngle),
                                  signedPer("pitch_rad", 24, 16, kAngle),
                                  signedPer("roll_rad", 40, 16, kAngle)};
constexpr std::array kVariation = {sidField(), integer("days_since_1970", 16, 16),
                                   signedPer("variation_rad", 32, 16, kAngle)};
constexpr std::array kDirectCurrent = {sidField(),
                                       integer("instance", 8, 8),
                                       named("dc_type", 16, 8, kDcType),
                                       integer("state_of_charge_percent", 24, 8),
                                       integer("state_of_health_percent", 32, 8),
                                       unsignedTimes("time_remaining_s", 40, 16, 60),
                                       unsignedPer("ripple_v", 56, 16, 1e3),
                                       unsignedTimes("remaining_capacity_c", 72, 16, 3600)};
constexpr std::array kBattery = {integer("instance", 0, 8), signedPer("voltage_v", 8, 16, 100),
                                 signedPer("current_a", 24, 16, 10), celsius("temperature_c", 40, 16, 100),
                                 sidField(56)};
constexpr std::array kSpeed = {sidField(), unsignedPer("water_speed_mps", 8, 16, kCentimetre),
                               unsignedPer("ground_speed_mps", 24, 16, kCentimetre),
                               named("water_speed_type", 40, 8, kWaterSpeed)};
constexpr std::array kDepth = {sidField(), unsignedPer("depth_m", 8, 32, kCentimetre),
                               signedPer("offset_m", 40, 16, kMillimetre),
                               unsignedTimes("range_m", 56, 8, 10)};
constexpr std::array kDistanceLog = {integer("days_since_1970", 0, 16),
                                     unsignedPer("time_of_day_s", 16, 32, kClock), integer("log_m", 48, 32),
                                     integer("trip_log_m", 80, 32)};
constexpr std::array kPosition = {signedPer("latitude_deg", 0, 32, kDegree7),
                                  signedPer("longitude_deg", 32, 32, kDegree7)};
constexpr std::array kCourse = {sidField(), named("cog_reference", 8, 2, kNorth),
                                unsignedPer("cog_rad", 16, 16, kAngle),
                                unsignedPer("sog_mps", 32, 16, kCentimetre)};
constexpr std::array kGnss = {sidField(),
                              integer("days_since_1970", 8, 16),
                              unsignedPer("time_of_day_s", 24, 32, kClock),
                              signedPer("latitude_deg", 56, 64, kDegree16),
                              signedPer("longitude_deg", 120, 64, kDegree16),
                              signedPer("altitude_m", 184, 64, 1e6),
                              named("method", 252, 4, kGnssMethod),
                              integer("satellites", 264, 8),
                              signedPer("hdop", 272, 16, 100),
                              signedPer("pdop", 288, 16, 100),
                              signedPer("geoidal_separation_m", 304, 32, kCentimetre)};
constexpr std::array kWindData = {sidField(), unsignedPer("wind_speed_mps", 8, 16, kCentimetre),
                                  unsignedPer("wind_angle_rad", 24, 16, kAngle),
                                  named("reference", 40, 3, kWind)};
constexpr std::array kEnvironmentOld = {sidField(), celsius("water_temperature_c", 8, 16, 100),
                                        celsius("outside_temperature_c", 24, 16, 100),
                                        unsignedTimes("atmospheric_pressure_pa", 40, 16, 100)};
constexpr std::array kEnvironment = {
    sidField(), named("temperature_source", 8, 6, kTemperature), celsius("temperature_c", 16, 16, 100),
    signedPer("humidity_percent", 32, 16, 250), unsignedTimes("atmospheric_pressure_pa", 48, 16, 100)};
constexpr std::array kTemperatureOld = {
    sidField(), integer("instance", 8, 8), named("source", 16, 8, kTemperature),
    celsius("temperature_c", 24, 16, 100), celsius("set_temperature_c", 40, 16, 100)};
constexpr std::array kActualPressure = {sidField(), integer("instance", 8, 8),
                                        named("source", 16, 8, kPressure),
                                        signedPer("pressure_pa", 24, 32, 10)};
constexpr std::array kTemperatureExtended = {
    sidField(), integer("instance", 8, 8), named("source", 16, 8, kTemperature),
    celsius("temperature_c", 24, 24, 1000), celsius("set_temperature_c", 48, 16, 10)};
constexpr std::array kSalinity = {integer("days_since_1970", 8, 16),
                                  unsignedPer("time_of_day_s", 24, 32, kClock),
                                  signedPer("latitude_deg", 56, 32, kDegree7),
                                  signedPer("longitude_deg", 88, 32, kDegree7),
                                  floating("salinity_ppt", 120),
                                  celsius("water_temperature_c", 152, 16, 100)};
constexpr std::array kVesselSpeed = {signedPer("longitudinal_water_speed_mps", 0, 16, kMillimetre),
                                     signedPer("transverse_water_speed_mps", 16, 16, kMillimetre),
                                     signedPer("longitudinal_ground_speed_mps", 32, 16, kMillimetre),
                                     signedPer("transverse_ground_speed_mps", 48, 16, kMillimetre),
                                     signedPer("stern_water_speed_mps", 64, 16, kMillimetre),
                                     signedPer("stern_ground_speed_mps", 80, 16, kMillimetre)};

constexpr std::array kPgns = {
    N2kPgnSpec{126992, false, "system time", kSystemTime},
    N2kPgnSpec{127245, false, "rudder", kRudder},
    N2kPgnSpec{127250, false, "vessel heading", kHeading},
    N2kPgnSpec{127251, false, "rate of turn", kRateOfTurn},
    N2kPgnSpec{127257, false, "attitude", kAttitude},
    N2kPgnSpec{127258, false, "magnetic variation", kVariation},
    N2kPgnSpec{127506, true, "DC detailed status", kDirectCurrent},
    N2kPgnSpec{127508, false, "battery status", kBattery},
    N2kPgnSpec{128259, false, "speed", kSpeed},
    N2kPgnSpec{128267, false, "water depth", kDepth},
    N2kPgnSpec{128275, true, "distance log", kDistanceLog},
    N2kPgnSpec{129025, false, "position, rapid update", kPosition},
    N2kPgnSpec{129026, false, "course and speed over ground, rapid update", kCourse},
    N2kPgnSpec{129029, true, "GNSS position data", kGnss},
    N2kPgnSpec{130306, false, "wind data", kWindData},
    N2kPgnSpec{130310, false, "environmental parameters (obsolete)", kEnvironmentOld},
    N2kPgnSpec{130311, false, "environmental parameters", kEnvironment},
    N2kPgnSpec{130312, false, "temperature", kTemperatureOld},
    N2kPgnSpec{130314, false, "actual pressure", kActualPressure},
    N2kPgnSpec{130316, false, "temperature, extended range", kTemperatureExtended},
    N2kPgnSpec{130321, true, "salinity station data", kSalinity},
    N2kPgnSpec{130578, true, "vessel speed components", kVesselSpeed},
};
static_assert(std::ranges::is_sorted(kPgns, {}, &N2kPgnSpec::pgn));

}  // namespace

const N2kPgnSpec* findN2kPgn(std::uint32_t pgn) noexcept {
  const auto found = std::ranges::lower_bound(kPgns, pgn, {}, &N2kPgnSpec::pgn);
  return found != kPgns.end() && found->pgn == pgn ? &*found : nullptr;
}

std::span<const N2kPgnSpec> n2kPgns() noexcept {
  return kPgns;
}

}  // namespace fathom::io
