#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/report.hpp"

namespace fathom::telemetry {

// What the ship has asked for that outlasts the moment, and what became of each request. A wish lasts as long
// as somebody is there: after kUnheard_s without a word from the ship the pause ends and the configured rate
// holds again; so it does where the ship has acknowledged nothing that was sent at the rate asked for. All of
// it survives a restart, and is told in the report.
class Wishes {
 public:
  static constexpr double kUnheard_s = 600;

  explicit Wishes(double configured_rate_bps) : configured_bps_(configured_rate_bps) {}

  [[nodiscard]] bool paused() const { return paused_; }
  [[nodiscard]] const std::array<RequestOutcome, 6>& outcomes() const { return outcomes_; }

  void heard(std::int64_t now_ns) { heard_ns_ = now_ns; }
  void pause(bool paused) { paused_ = paused; }
  // The ship has asked for another rate than the one that holds; `next`: the first frame sent at it.
  void rateAsked(Version next, std::int64_t now_ns);
  void acknowledged(Version newest);
  // Of a request that was heard; the newest of an id stands. What is done longest gives way.
  void note(const RequestOutcome& outcome);
  // Another state of that request, if it is still told of.
  void become(const RequestOutcome& outcome);
  // Ends what has lasted too long. The rate that holds again, if another did.
  [[nodiscard]] std::optional<double> lapse(std::int64_t now_ns);

  // For saved state (state_archive.hpp), bit by bit, into one of the same configuration.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.paused_, self.asked_, self.proven_, self.first_at_rate_);
    archive.instants(self.heard_ns_, self.asked_ns_);
    for (auto& o : self.outcomes_) {
      archive.enumeration(o.state, RequestOutcome::State::kRefused);
      archive(o.id, o.counter);
      archive.require(o.id <= schema::kRequestId.max, "a request that cannot be");
    }
  }

 private:
  double configured_bps_;
  bool paused_ = false;
  bool asked_ = false;         // another rate than the configured one holds
  bool proven_ = false;        // a frame sent at it was acknowledged
  Version first_at_rate_ = 0;  // frame
  std::int64_t heard_ns_ = 0, asked_ns_ = 0;
  std::array<RequestOutcome, 6> outcomes_{};  // newest first
};

}  // namespace fathom::telemetry
