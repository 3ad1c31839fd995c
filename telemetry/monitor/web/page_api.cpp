#include "telemetry/monitor/web/page_api.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"
#include "telemetry/monitor/map/received_map.hpp"

namespace fathom::monitor {

using nlohmann::ordered_json;
using Json = nlohmann::json;
using telemetry::FrameVerdict;
using telemetry::MessageType;
using telemetry::Request;

namespace {

constexpr double kRateWindow_s = 60, kLossWindow_s = 300;

// Times a billionth, not divided by 1e9 as rt::seconds() is: the digits in the JSON stay as they are.
double seconds(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-9;
}

ordered_json orNull(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}

double rounded(double value, double step) {
  return std::round(value / step) * step;
}

ordered_json statusJson(const telemetry::Status& s, std::uint16_t flags) {
  ordered_json health = ordered_json::array();
  for (unsigned bit = 0; bit < telemetry::kHealthBits; ++bit)
    if ((flags >> bit & 1U) != 0) health.push_back(telemetry::healthText(bit));
  return {{"utc_s", seconds(s.utc_ns)},
          {"north_m", s.north},
          {"east_m", s.east},
          {"depth_m", s.depth},
          {"roll_deg", s.roll / kRadiansPerDegree},
          {"pitch_deg", s.pitch / kRadiansPerDegree},
          {"heading_deg", s.heading / kRadiansPerDegree},
          {"altitude_m", orNull(s.altitude)},
          {"speed_mps", s.speed},
          {"position_sigma_m", orNull(s.position_sigma)},
          {"battery_percent", orNull(s.battery * 100)},
          {"pairs_seen", s.pairs_seen},
          {"pairs_dropped", s.pairs_dropped},
          {"map_area_m2", s.map_area},
          {"mission_progress", orNull(s.mission_progress)},
          {"health", health},
          {"slipped_cycles", s.late_cycles},
          {"shed_work", s.shed_work},
          {"pool_refusals", s.pool_refusals}};
}

ordered_json linkJson(const MonitorModel& model, std::int64_t now_utc_ns) {
  const auto& c = model.receiver().counters();
  const auto& tiles = model.reassembler().counters();
  ordered_json rejected, types;
  for (std::size_t v = 1; v < telemetry::kFrameVerdicts; ++v)
    rejected[telemetry::name(static_cast<FrameVerdict>(v))] = c.verdicts[v];
  for (const auto type :
       {MessageType::kReport, MessageType::kStatus, MessageType::kTrack, MessageType::kMissionInfo,
        MessageType::kMapPacket, MessageType::kRepair, MessageType::kTileFragment})
    types[telemetry::name(type)] = model.accepted(type);
  const auto last = model.lastAcceptedUtcNs();
  return {{"frames", c.frames},
          {"bytes", c.bytes},
          {"accepted", c[FrameVerdict::kAccepted]},
          {"lost", c.lost},
          {"repaired", c.repaired},
          {"reordered", c.reordered},
          {"rejected", rejected},
          {"types", types},
          {"rate_bps", model.history().recent(kRateWindow_s, now_utc_ns).rate_bps},
          {"recent_loss", orNull(model.history().recent(kLossWindow_s, now_utc_ns).loss)},
          {"last_utc_s", last ? ordered_json(seconds(*last)) : ordered_json(nullptr)},
          {"age_s", last ? ordered_json(std::max(0.0, seconds(now_utc_ns - *last))) : ordered_json(nullptr)},
          {"tiles_open", model.reassembler().open()},
          {"tiles_undecodable", tiles.undecodable + tiles.conflicting}};
}

ordered_json mapJson(ModelView& view) {
  const BlockStore& store = view.store();
  const Coverage& coverage = view.coverage();
  ordered_json levels = ordered_json::array();
  for (telemetry::SpacingCode code = kCoarsestCode + 1; code-- > 0;)
    if (store.size(code) > 0)
      levels.push_back({{"spacing_m", telemetry::spacingOf(code)}, {"blocks", store.size(code)}});
  return {{"chunks", store.chunks().size()},
          {"blocks", store.size()},
          {"levels", levels},
          {"area_m2", view.surface().area()},
          {"pending_m2", coverage.pending.size()},
          {"changed_m2", coverage.changed_area},
          {"changed_blocks", store.counters().changed},
          {"refused", store.counters().refused},
          {"evicted", store.counters().evicted}};
}

ordered_json downlinkJson(const SharedModel& shared) {
  const std::string why = shared.whySilent();
  ordered_json requests = ordered_json::array();
  for (const auto& entry : shared.model->requests().entries()) {
    const telemetry::Request& r = entry.request;
    ordered_json rectangle = nullptr;
    if (r.kind == telemetry::Request::Kind::kDetail)
      rectangle = {r.north_min, r.north_max, r.east_min, r.east_max};
    requests.push_back({{"id", r.id},
                        {"text", describe(r)},
                        {"state", name(entry.state)},
                        {"times_sent", entry.times_sent},
                        {"utc_s", seconds(entry.utc_ns)},
                        {"rectangle", rectangle}});
  }
  const telemetry::DownlinkSender* sender = shared.model->link().sender();
  const auto& report = shared.model->report();
  return {{"enabled", why.empty()},
          {"reason", why.empty() ? ordered_json(nullptr) : ordered_json(why)},
          {"frames_sent", sender == nullptr ? 0 : sender->counters().frames},
          {"paused", report && report->paused},
          {"vehicle_rate_bps", report ? ordered_json(report->rate_bps) : ordered_json(nullptr)},
          {"requests", requests}};
}

constexpr double kMaxSpeed = 10000;
constexpr double kMaxUtc_s = 4e9;  // the year 2096

// An object with only the keys named; null for anything else.
Json objectWith(std::string_view body, std::initializer_list<const char*> keys, std::string& why) {
  Json value =
      body.size() <= kMaxBodyBytes ? Json::parse(body, nullptr, false) : Json(Json::value_t::discarded);
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

std::optional<double> numberIn(const Json& value, double low, double high) {
  if (!value.is_number()) return std::nullopt;
  const auto number = value.get<double>();
  return number >= low && number <= high ? std::optional(number) : std::nullopt;
}

bool readRange(const Json& value, double& low, double& high) {
  if (!value.is_array() || value.size() != 2) return false;
  const auto a = numberIn(value[0], -1e6, 1e6), b = numberIn(value[1], -1e6, 1e6);
  if (!a || !b) return false;
  low = *a;
  high = *b;
  return true;
}

}  // namespace

std::string epochOf(const SharedModel& shared) {
  return std::to_string(shared.epoch) + "." + std::to_string(shared.model->map().store().generation());
}

std::string epochOf(const ModelView& view) {
  return std::to_string(view.epoch()) + "." + std::to_string(view.store().generation());
}

std::string stateJson(SharedModel& shared, ModelView& view) {
  view.refresh(shared);
  ordered_json map = mapJson(view);
  const std::lock_guard lock(shared.mutex);
  const MonitorModel& model = *shared.model;
  ordered_json json{
      {"epoch", epochOf(shared)},
      {"version", model.version()},
      {"map_version", model.map().version()},
      {"track_points", model.track().size()},
      {"recorded", shared.playback.has_value()},
      {"finished", shared.playback && shared.playback->finished},
      {"now_utc_s", seconds(shared.now_utc_ns)},
      {"not_kept", shared.not_kept.empty() ? ordered_json(nullptr) : ordered_json(shared.not_kept)},
      {"clocks_apart_s",
       model.clocksApart() ? ordered_json(seconds(*model.clocksApart())) : ordered_json(nullptr)}};
  json["playback"] = nullptr;
  if (const auto& p = shared.playback)
    json["playback"] = {{"first_utc_s", seconds(p->first_utc_ns)},
                        {"last_utc_s", seconds(p->last_utc_ns)},
                        {"at_utc_s", seconds(p->at_utc_ns)},
                        {"speed", p->speed},
                        {"playing", p->playing}};
  json["identity"] = nullptr;
  if (const auto& id = model.receiver().identity())
    json["identity"] = {{"vehicle_id", id->vehicle_id}, {"dive_id", id->dive_id}};
  json["mission"] = nullptr;
  if (const auto& m = model.mission())
    json["mission"] = {{"vehicle_name", m->vehicle_name},
                       {"origin_latitude_deg", m->origin.latitude / kRadiansPerDegree},
                       {"origin_longitude_deg", m->origin.longitude / kRadiansPerDegree},
                       {"start_utc_s", seconds(m->start_utc_ns)},
                       {"schema_differs", model.schemaDiffers()}};
  json["status"] = model.status() ? statusJson(*model.status(), model.health()) : ordered_json(nullptr);
  json["link"] = linkJson(model, shared.now_utc_ns);
  json["map"] = std::move(map);
  json["downlink"] = downlinkJson(shared);
  return json.dump();
}

std::string trackJson(const ModelView& view) {
  ordered_json points = ordered_json::array();
  for (const auto& [utc_ns, p] : view.track()) points.push_back({seconds(utc_ns), p.north, p.east, p.depth});
  return ordered_json{{"points", points}}.dump();
}

std::string historyJson(const MonitorModel& model) {
  const LinkHistory& history = model.history();
  const double step_s = seconds(history.step());
  ordered_json steps = ordered_json::array();
  for (const auto& step : history.steps())
    steps.push_back({rounded(8 * static_cast<double>(step.bytes) / step_s, 0.1), step.accepted, step.lost,
                     step.rejected});
  return ordered_json{{"start_utc_s", seconds(history.start())}, {"step_s", step_s}, {"steps", steps}}.dump();
}

std::string profileJson(const Surface& surface, double north0, double east0, double north1, double east1) {
  ordered_json points = ordered_json::array();
  const double length = hypotenuse(north1 - north0, east1 - east0);
  for (int k = 0; k <= kProfilePoints; ++k) {
    const double f = static_cast<double>(k) / kProfilePoints;
    const auto point = surface.sample(north0 + f * (north1 - north0), east0 + f * (east1 - east0));
    if (point)
      points.push_back({rounded(f * length, 1e-3), rounded(point->depth, 1e-3), rounded(point->sigma, 1e-3)});
    else
      points.push_back(nullptr);
  }
  return ordered_json{{"points", points}}.dump();
}

std::string coverageBinary(const Coverage& coverage) {
  std::string out = "FCOV";
  appendBytes(out, static_cast<std::uint32_t>(coverage.pending.size()));
  for (const PendingSquare& square : coverage.pending) {
    appendBytes(out, square.north);
    appendBytes(out, square.east);
    appendBytes(out, square.depth);
  }
  return out;
}

std::optional<Request> parseRequest(std::string_view body, std::string& why) {
  const Json value =
      objectWith(body, {"kind", "north_m", "east_m", "spacing_m", "max_error_m", "rate_bps"}, why);
  if (value.is_null()) return std::nullopt;
  Request request;
  const Json kind = value.value("kind", Json());
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
    const auto spacing = numberIn(value.value("spacing_m", Json()), 0, 16),
               error = numberIn(value.value("max_error_m", Json()), 0, 16);
    if (!readRange(value.value("north_m", Json()), request.north_min, request.north_max) ||
        !readRange(value.value("east_m", Json()), request.east_min, request.east_max) || !spacing || !error) {
      why = "detail needs \"north_m\" and \"east_m\" [from, to], \"spacing_m\" and \"max_error_m\"";
      return std::nullopt;
    }
    request.spacing = *spacing;
    request.max_error = *error;
  }
  if (request.kind == Request::Kind::kRate) {
    const auto rate = numberIn(value.value("rate_bps", Json()), 0, 1e6);
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
  const Json value = objectWith(body, {"utc_s", "latitude_deg", "longitude_deg", "depth_m", "sigma_m"}, why);
  if (value.is_null()) return std::nullopt;
  const auto utc = numberIn(value.value("utc_s", Json()), 0, kMaxUtc_s),
             latitude = numberIn(value.value("latitude_deg", Json()), -90, 90),
             longitude = numberIn(value.value("longitude_deg", Json()), -180, 180);
  telemetry::UsblFixMessage fix;
  bool good = utc && latitude && longitude;
  const auto optional = [&](const char* key, double& out) {
    const Json given = value.value(key, Json());
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

std::optional<PlaybackRequest> parsePlayback(std::string_view body, std::string& why) {
  const Json value = objectWith(body, {"seek_utc_s", "speed", "playing"}, why);
  if (value.is_null()) return std::nullopt;
  PlaybackRequest request;
  bool good = !value.empty();
  if (value.contains("seek_utc_s")) {
    const auto seconds = numberIn(value["seek_utc_s"], 0, kMaxUtc_s);
    good = good && seconds;
    if (seconds) request.seek_utc_ns = static_cast<std::int64_t>(*seconds * 1e9);
  }
  if (value.contains("speed")) {
    request.speed = numberIn(value["speed"], 0, kMaxSpeed);
    good = good && request.speed;
  }
  if (value.contains("playing")) {
    good = good && value["playing"].is_boolean();
    if (value["playing"].is_boolean()) request.playing = value["playing"].get<bool>();
  }
  if (good) return request;
  why = "needs \"seek_utc_s\", \"speed\" (0 to 10000) or \"playing\"";
  return std::nullopt;
}

}  // namespace fathom::monitor
