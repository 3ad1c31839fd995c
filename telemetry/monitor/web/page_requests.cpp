#include "telemetry/monitor/web/page_requests.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

namespace fathom::monitor {

using nlohmann::json;
using telemetry::Request;

namespace {

constexpr double kMaxSpeed = 10000;
constexpr double kMaxUtc_s = 4e9;  // the year 2096

// An object with only the keys named; null for anything else.
json objectWith(std::string_view body, std::initializer_list<const char*> keys, std::string& why) {
  json value =
      body.size() <= kMaxBodyBytes ? json::parse(body, nullptr, false) : json(json::value_t::discarded);
  if (!value.is_object()) {
    why = "the body is not a JSON object of at most " + std::to_string(kMaxBodyBytes) + " bytes";
    return nullptr;
  }
  for (const auto& entry : value.items()) {
    const auto known = [&](const char* key) { return entry.key() == key; };
    if (std::any_of(keys.begin(), keys.end(), known)) continue;
    why = "there is a key that means nothing here";
    return nullptr;
  }
  return value;
}

std::optional<double> numberIn(const json& value, double low, double high) {
  if (!value.is_number()) return std::nullopt;
  const auto number = value.get<double>();
  return number >= low && number <= high ? std::optional(number) : std::nullopt;
}

bool readRange(const json& value, double& low, double& high) {
  if (!value.is_array() || value.size() != 2) return false;
  const auto a = numberIn(value[0], -1e6, 1e6), b = numberIn(value[1], -1e6, 1e6);
  if (!a || !b) return false;
  low = *a;
  high = *b;
  return true;
}

}  // namespace

std::optional<Request> parseRequest(std::string_view body, std::string& why) {
  const json value =
      objectWith(body, {"kind", "north_m", "east_m", "spacing_m", "max_error_m", "rate_bps"}, why);
  if (value.is_null()) return std::nullopt;
  Request request;
  const json kind = value.value("kind", json());
  bool known = false;
  for (std::size_t k = 0; kind.is_string() && k < telemetry::kRequestKinds; ++k) {
    if (kind.get<std::string>() != telemetry::name(static_cast<Request::Kind>(k))) continue;
    request.kind = static_cast<Request::Kind>(k);
    known = true;
  }
  if (!known) {
    why = "\"kind\" is none of the known requests";
    return std::nullopt;
  }
  if (request.kind == Request::Kind::kDetail) {
    const auto spacing = numberIn(value.value("spacing_m", json()), 0, 16),
               error = numberIn(value.value("max_error_m", json()), 0, 16);
    if (!readRange(value.value("north_m", json()), request.north_min, request.north_max) ||
        !readRange(value.value("east_m", json()), request.east_min, request.east_max) || !spacing || !error) {
      why = "detail needs \"north_m\" and \"east_m\" [from, to], \"spacing_m\" and \"max_error_m\"";
      return std::nullopt;
    }
    request.spacing = *spacing;
    request.max_error = *error;
  }
  if (request.kind == Request::Kind::kRate) {
    const auto rate = numberIn(value.value("rate_bps", json()), 0, 1e6);
    if (!rate) {
      why = "rate needs \"rate_bps\"";
      return std::nullopt;
    }
    request.rate_bps = *rate;
  }
  if (!telemetry::validate(request)) {
    why =
        "a value is out of bounds: sides 0.1 to 819 m, spacing a power of two from 1/64 to 1 m, error 0.01 "
        "to "
        "0.32 m, rate 80 to 10310 bit/s";
    return std::nullopt;
  }
  return request;
}

std::optional<telemetry::UsblFixMessage> parseFix(std::string_view body, std::string& why) {
  const json value = objectWith(body, {"utc_s", "latitude_deg", "longitude_deg", "depth_m", "sigma_m"}, why);
  if (value.is_null()) return std::nullopt;
  const auto utc = numberIn(value.value("utc_s", json()), 0, kMaxUtc_s),
             latitude = numberIn(value.value("latitude_deg", json()), -90, 90),
             longitude = numberIn(value.value("longitude_deg", json()), -180, 180);
  telemetry::UsblFixMessage fix;
  bool good = utc && latitude && longitude;
  const auto optional = [&](const char* key, double& out) {
    const json given = value.value(key, json());
    const auto number = numberIn(given, 0, 1e5);
    good = good && (given.is_null() || number);
    out = number.value_or(std::numeric_limits<double>::quiet_NaN());
  };
  optional("depth_m", fix.depth);
  optional("sigma_m", fix.sigma);
  if (good) {
    fix.utc_ns = static_cast<std::int64_t>(*utc * 1e9);
    fix.latitude = *latitude;
    fix.longitude = *longitude;
    if (telemetry::validate(fix)) return fix;
  }
  why = "needs \"utc_s\", \"latitude_deg\", \"longitude_deg\", and may have \"depth_m\" and \"sigma_m\"";
  return std::nullopt;
}

std::optional<PlaybackWish> parsePlayback(std::string_view body, std::string& why) {
  const json value = objectWith(body, {"seek_utc_s", "speed", "playing"}, why);
  if (value.is_null()) return std::nullopt;
  PlaybackWish wish;
  bool good = !value.empty();
  if (value.contains("seek_utc_s")) {
    const auto seconds = numberIn(value["seek_utc_s"], 0, kMaxUtc_s);
    good = good && seconds;
    if (seconds) wish.seek_utc_ns = static_cast<std::int64_t>(*seconds * 1e9);
  }
  if (value.contains("speed")) {
    wish.speed = numberIn(value["speed"], 0, kMaxSpeed);
    good = good && wish.speed;
  }
  if (value.contains("playing")) {
    good = good && value["playing"].is_boolean();
    if (value["playing"].is_boolean()) wish.playing = value["playing"].get<bool>();
  }
  if (good) return wish;
  why = "needs \"seek_utc_s\", \"speed\" (0 to 10000) or \"playing\"";
  return std::nullopt;
}

}  // namespace fathom::monitor
