#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

namespace fathom::rt {

// One tier's sign of life. The tier beats, the supervisor reads; wait-free.
class Heartbeat {
 public:
  // By the tier, at least once a period, and before and after anything that may take long.
  void beat(std::int64_t monotonic_ns) noexcept {
    last_ns_.store(monotonic_ns, std::memory_order_relaxed);
    beats_.store(beats_.load(std::memory_order_relaxed) + 1, std::memory_order_release);
  }
  [[nodiscard]] std::uint64_t beats() const noexcept { return beats_.load(std::memory_order_acquire); }
  [[nodiscard]] std::int64_t lastNs() const noexcept { return last_ns_.load(std::memory_order_relaxed); }

 private:
  std::atomic<std::int64_t> last_ns_{0};
  std::atomic<std::uint64_t> beats_{0};
};

// Finds tiers without a heartbeat and decides the remedy: restart those that can be restarted (device
// threads, the bus, the recorder's thread), at growing intervals, and report the others, so that navigation
// and recording continue without them. No heap and no lock after the tiers are added; one thread calls
// step().
class Watchdog {
 public:
  static constexpr std::size_t kMaxTiers = 16;
  // Restarts without a heartbeat between them before a tier counts as given up. Restarts continue even then,
  // at the longest interval: at sea there is no operator to do it.
  static constexpr std::uint32_t kMaxRestarts = 5;
  // Between two restarts of one tier: its limit times this, doubled with each of the first kMaxRestarts.
  static constexpr std::int64_t kRestartWait = 2;

  enum class Remedy : std::uint8_t {
    kRestart,    // stuck, and restartable: start it again
    kGiveUp,     // not to be restarted, or in vain so far: report it and continue without it
    kRecovered,  // beats again
  };
  struct TierSpec {
    const char* name = "";
    std::int64_t limit_ns = 0;  // without a beat for so long: stuck
    bool restartable = false;
  };
  struct TierState {
    TierSpec spec;
    bool watched = false;
    bool stuck = false;
    bool given_up = false;
    std::uint64_t times_stuck = 0, restarts = 0;
    std::int64_t silent_ns = 0, longest_silent_ns = 0;
  };

  // Before the tiers run; the name's text must outlive the watchdog. Gives the tier's number; a full watchdog
  // is a broken contract.
  std::size_t add(const TierSpec& spec) noexcept;
  [[nodiscard]] Heartbeat& heartbeat(std::size_t tier) noexcept { return hearts_.at(tier); }

  // From now on the tier must beat; unwatch() for a tier that rests on purpose.
  void watch(std::size_t tier, std::int64_t now_ns) noexcept;
  void unwatch(std::size_t tier) noexcept;

  // Looks at every tier; act(tier, Remedy) is called in the tiers' order for each that needs something.
  template <typename Act>
  void step(std::int64_t now_ns, Act&& act) noexcept(noexcept(act(std::size_t{}, Remedy{}))) {
    for (std::size_t tier = 0; tier < count_; ++tier) {
      Remedy remedy{};
      if (look(tier, now_ns, remedy)) act(tier, remedy);
    }
  }

  [[nodiscard]] std::size_t tiers() const noexcept { return count_; }
  [[nodiscard]] const TierState& state(std::size_t tier) const noexcept { return states_.at(tier).shown; }

 private:
  struct Watch {
    TierState shown;
    std::uint64_t beats_seen = 0;
    std::int64_t last_life_ns = 0;  // last beat, or when watching began
    std::int64_t next_restart_ns = 0;
    std::uint32_t restarts_in_a_row = 0;
  };
  bool look(std::size_t tier, std::int64_t now_ns, Remedy& remedy) noexcept;

  std::size_t count_ = 0;
  std::array<Heartbeat, kMaxTiers> hearts_{};
  std::array<Watch, kMaxTiers> states_{};
};

}  // namespace fathom::rt
