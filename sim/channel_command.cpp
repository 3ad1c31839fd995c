#include <charconv>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "realtime/kernel/input_error.hpp"
#include "sim/commands.hpp"
#include "sim/link/channel_relay.hpp"

namespace fathom::sim {
namespace {

// Splits "HOST:PORT".
void parseTarget(const std::string& target, ChannelRelayOptions& options) {
  const std::size_t colon = target.rfind(':');
  const char* end = target.data() + target.size();
  if (colon != std::string::npos) {
    options.to_host = target.substr(0, colon);
    const auto [stop, error] = std::from_chars(target.data() + colon + 1, end, options.to_port);
    if (error == std::errc() && stop == end && !options.to_host.empty() && options.to_port != 0) return;
  }
  throw InputError("--to", target, "is not HOST:PORT with a port of 1 to 65535");
}

}  // namespace

Command addChannelCommand(CLI::App& app) {
  struct State {
    ChannelRelayOptions options;
    std::string target;
    std::optional<double> down_loss, down_burst, down_rate;
  };
  const auto state = std::make_shared<State>();
  ChannelRelayOptions& o = state->options;
  CLI::App* command = app.add_subcommand(
      "channel", "relay UDP frames through a simulated acoustic channel, until idle or SIGTERM");
  command->footer("Example: fathom-sim channel --listen 14700 --to 127.0.0.1:14701 --loss 0.1 --rate 300");
  command->add_option("--listen", o.listen_port, "UDP port that takes the vehicle's frames")
      ->required()
      ->check(CLI::Range(1, 65535));
  command->add_option("--to", state->target, "HOST:PORT that gets what arrives")->required();
  command->add_option("--loss", o.channel.loss, "share of the frames that are lost")->capture_default_str();
  command
      ->add_option("--burst", o.channel.mean_burst,
                   "mean length of runs of lost frames (Gilbert-Elliott), 0: each by itself")
      ->capture_default_str();
  command->add_option("--duplicate", o.channel.duplicate, "that it arrives twice")->capture_default_str();
  command->add_option("--reorder", o.channel.reorder, "that later frames overtake it")->capture_default_str();
  command->add_option("--corrupt", o.channel.corrupt, "that bytes of it are damaged")->capture_default_str();
  command->add_option("--delay", o.channel.delay_s, "travel time [s]")->capture_default_str();
  command->add_option("--rate", o.channel.rate_bps, "of the modem [bit/s], 0: no limit")
      ->capture_default_str();
  command->add_option("--queue", o.channel.queue_frames, "frames that wait for the modem; more are refused")
      ->capture_default_str();
  command->add_flag("--half-duplex", o.half_duplex, "neither modem hears while it speaks (needs a --rate)");
  command->add_option("--down-loss", state->down_loss,
                      "like --loss, from the ship to the vehicle (default: the same)");
  command->add_option("--down-burst", state->down_burst, "like --burst, from the ship to the vehicle");
  command->add_option("--down-rate", state->down_rate, "like --rate, of the ship's modem");
  command->add_option("--seed", o.channel.seed, "of every random number")->capture_default_str();
  command->add_option("--idle-exit", o.idle_exit_s, "end after this long without a frame [s], 0: never")
      ->check(CLI::NonNegativeNumber);
  return {command, [state] {
            parseTarget(state->target, state->options);
            ChannelConfig& down = state->options.down = state->options.channel;
            down.loss = state->down_loss.value_or(down.loss);
            down.mean_burst = state->down_burst.value_or(down.mean_burst);
            down.rate_bps = state->down_rate.value_or(down.rate_bps);
            try {
              return runChannelRelay(state->options);
            } catch (const std::invalid_argument& e) {
              throw InputError("channel", "", e.what());
            }
          }};
}

}  // namespace fathom::sim
