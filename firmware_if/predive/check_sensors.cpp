#include <algorithm>
#include <cmath>
#include <numbers>
#include <type_traits>
#include <variant>

#include "firmware_if/predive/predive_checks.hpp"
#include "firmware_if/predive/predive_text.hpp"

namespace fathom::io {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kRateShare = 0.8;        // of the least rate with which a device passes
constexpr double kDamagedShare = 0.05;    // of the ensembles: a bad line
constexpr double kEarthRadius = 6.371e6;  // [m]

// The place of a kind of sample in SensorSample.
template <class Sample, std::size_t At = 0>
consteval std::size_t kindOf() {
  if constexpr (std::is_same_v<std::variant_alternative_t<At, SensorSample>, Sample>) {
    return At;
  } else {
    return kindOf<Sample, At + 1>();
  }
}
template <class Sample>
constexpr std::size_t kKind = kindOf<Sample>();

const DeviceHealth* sourceNamed(const PrediveFacts& facts, std::string_view name) {
  for (const DeviceHealth& source : facts.sources)
    if (source.name == name) return &source;
  return nullptr;
}

std::uint64_t counterOf(const DeviceHealth* health, std::string_view name) {
  if (health != nullptr)
    for (const auto& [known, value] : health->counters)
      if (known == name) return value;
  return 0;
}

double metresFromOrigin(const MissionConfig& mission, double latitude, double longitude) {
  const double north = latitude - mission.origin.latitude;
  const double east = std::remainder(longitude - mission.origin.longitude, 2 * std::numbers::pi) *
                      std::cos(mission.origin.latitude);
  return kEarthRadius * std::hypot(north, east);
}

std::string rateText(const SampleFacts& facts, double wanted_hz) {
  return decimals(facts.rateHz(), 1) + " Hz of " + decimals(wanted_hz, 1) + ", longest gap " +
         decimals(facts.longest_gap_s, 2) + " s";
}

bool slow(const SampleFacts& facts, double wanted_hz) {
  return facts.rateHz() < kRateShare * wanted_hz;
}

void checkDvl(const PrediveFacts& facts, const PrediveConfig& limits, PrediveReport& report) {
  const SampleFacts& dvl = facts.samples[kKind<DvlSample>];
  const DeviceHealth* source = sourceNamed(facts, "dvl");
  const std::uint64_t ensembles = counterOf(source, "ensembles"), bad = counterOf(source, "bad_checksum");
  const auto refuse = [&](const std::string& found, const std::string& fix) {
    report.bad("DVL", found, fix);
  };
  if (!facts.expected[kKind<DvlSample>])
    return refuse("none is configured", "set dvl.device, or add dvl to lcm.accept, in onboard.toml");
  if (dvl.count == 0) {
    if (source == nullptr) return refuse("silent on LCM", "start the program that publishes RDI");
    if (!source->open)
      return refuse(
          "its line is not there" + (source->reason.empty() ? "" : ": " + std::string(source->reason.view())),
          "look at the cable and at dvl.device; end programs that use the line");
    if (counterOf(source, "bytes") == 0)
      return refuse("silent", "look at its power and cable; it must ping by itself (CS)");
    if (ensembles == 0)
      return refuse(std::to_string(counterOf(source, "bytes")) + " bytes, but no ensemble",
                    "look at the baud rate of dvl.device and at dvl.format");
    return refuse(plural(ensembles, "ensemble") + " without bottom track", "switch bottom track on (BP1)");
  }
  const std::string found =
      rateText(dvl, limits.dvl_hz) +
      (dvl.usable == 0
           ? ", no bottom lock (as in air)"
           : ", velocity in " +
                 decimals(100.0 * static_cast<double>(dvl.usable) / static_cast<double>(dvl.count), 0) +
                 " %");
  if (static_cast<double>(bad) > kDamagedShare * static_cast<double>(ensembles + bad))
    return refuse(found + ", " + plural(bad, "damaged ensemble"), "look at cable, ground and baud rate");
  if (slow(dvl, limits.dvl_hz)) return refuse(found, "look at its ping rate (TP, TE), or set predive.dvl_hz");
  report.good("DVL", found);
}

void checkCompass(const PrediveFacts& facts, const PrediveConfig& limits, PrediveReport& report) {
  const SampleFacts& seen = facts.samples[kKind<AttitudeSample>];
  if (!facts.expected[kKind<AttitudeSample>])
    return report.bad("compass", "none is configured",
                      "set can.interface, or add attitude to lcm.accept, in onboard.toml");
  if (seen.count == 0)
    return report.bad("compass", "silent",
                      "look at its power, at the bus (candump, lcm-spy) and at who publishes it");
  const auto& attitude = std::get<AttitudeSample>(seen.last);
  const std::string found =
      rateText(seen, limits.compass_hz) + "; heading " + decimals(attitude.heading / kDegree, 1) + ", roll " +
      decimals(attitude.roll / kDegree, 1) + ", pitch " + decimals(attitude.pitch / kDegree, 1) + " deg";
  if (slow(seen, limits.compass_hz))
    report.bad("compass", found, "raise its rate, or set predive.compass_hz");
  else if (std::max(std::abs(attitude.roll), std::abs(attitude.pitch)) > limits.deck_tilt_deg * kDegree)
    report.bad("compass", found,
               "the vehicle does not lie so: look at how the compass is mounted, at its units and "
               "predive.deck_tilt_deg");
  else
    report.good("compass", found);
}

void checkDepth(const PrediveFacts& facts, const PrediveConfig& limits, PrediveReport& report) {
  const SampleFacts& seen = facts.samples[kKind<DepthSample>];
  if (!facts.expected[kKind<DepthSample>])
    return report.bad("depth", "none is configured",
                      "set can.interface, or add depth to lcm.accept, in onboard.toml");
  if (seen.count == 0)
    return report.bad("depth", "silent",
                      "look at its power, at the bus (candump, lcm-spy) and at who publishes it");
  const double depth = std::get<DepthSample>(seen.last).depth;
  const std::string found = rateText(seen, limits.depth_hz) + "; " + decimals(depth, 2) + " m";
  if (slow(seen, limits.depth_hz))
    report.bad("depth", found, "raise its rate, or set predive.depth_hz");
  else if (std::abs(depth) > limits.deck_depth_m)
    report.bad(
        "depth", found,
        "the vehicle is on deck: zero the pressure sensor, look at its units and predive.deck_depth_m");
  else
    report.good("depth", found);
}

void checkPositions(const PrediveFacts& facts, const MissionConfig& mission, const PrediveConfig& limits,
                    PrediveReport& report) {
  const SampleFacts& gps = facts.samples[kKind<GpsFix>];
  const auto place = [&](const char* name, double latitude, double longitude, double sigma) {
    const double away = metresFromOrigin(mission, latitude, longitude);
    const std::string found = decimals(latitude / kDegree, 5) + ", " + decimals(longitude / kDegree, 5) +
                              " deg, sigma " + decimals(sigma, 1) + " m, " + decimals(away / 1e3, 1) +
                              " km from the origin";
    if (away <= 1e3 * limits.origin_km)
      report.good(name, found);
    else
      report.bad(name, found,
                 "correct origin_latitude and origin_longitude of mission.toml, or the ship's position");
  };
  if (gps.count > 0) {
    const auto& fix = std::get<GpsFix>(gps.last);
    place("GPS", fix.latitude, fix.longitude, fix.sigma_horizontal);
  } else if (facts.expected[kKind<GpsFix>]) {
    report.bad("GPS", "silent", "look at its antenna and at who publishes it");
  } else {
    report.unused("GPS", "not used");
  }
  const SampleFacts& usbl = facts.samples[kKind<UsblFix>];
  if (usbl.count > 0) {
    const auto& fix = std::get<UsblFix>(usbl.last);
    place("USBL", fix.latitude, fix.longitude, fix.sigma_horizontal);
  } else if (facts.expected[kKind<UsblFix>] || facts.modem.used) {
    report.bad(
        "USBL", "no fix came in " + decimals(facts.seconds, 0) + " s",
        "start the ship's USBL and fathom-monitor, transponder in the water; look longer: --seconds 60");
  } else {
    report.unused("USBL", "not used");
  }
}

void checkBattery(const PrediveFacts& facts, const PrediveConfig& limits, PrediveReport& report) {
  const SampleFacts& seen = facts.samples[kKind<BatterySample>];
  if (seen.count == 0) {
    if (facts.expected[kKind<BatterySample>])
      report.bad("battery", "silent", "look at who publishes it");
    else
      report.unused("battery", "not told");
    return;
  }
  const auto& battery = std::get<BatterySample>(seen.last);
  const std::string found =
      (battery.voltage ? decimals(*battery.voltage, 1) + " V" : std::string("voltage not told")) +
      (battery.charge ? ", " + decimals(100 * *battery.charge, 0) + " % left" : "");
  if (battery.charge && *battery.charge < limits.least_charge)
    report.bad("battery", found, "charge it");
  else
    report.good("battery", found);
}

void checkModem(const ModemFacts& modem, PrediveReport& report) {
  if (!modem.used) return report.unused("modem", "not used");
  if (!modem.open)
    return report.bad("modem", modem.failure, "correct modem.device in onboard.toml, or the cable");
  const std::string found = plural(modem.frames, "frame") + " heard, " + std::to_string(modem.ours) +
                            " for this vehicle, " + std::to_string(modem.broken) + " broken";
  if (modem.frames == 0)
    report.bad("modem", found,
               "let fathom-monitor speak on the ship, transducers in one water; look longer: --seconds 60");
  else if (modem.ours == 0)
    report.bad("modem", found,
               "the ship speaks to another vehicle or dive: compare vehicle_id and dive_id of mission.toml");
  else
    report.good("modem", found);
}

}  // namespace

void checkSensors(const PrediveFacts& facts, const MissionConfig& mission, const PrediveConfig& limits,
                  PrediveReport& report) {
  checkDvl(facts, limits, report);
  checkCompass(facts, limits, report);
  checkDepth(facts, limits, report);
  checkPositions(facts, mission, limits, report);
  checkBattery(facts, limits, report);
  checkModem(facts.modem, report);
}

}  // namespace fathom::io
