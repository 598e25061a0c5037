// Cost of the live view for the servo loop: sessions on the monotonic clock, in turns without a view and with a view to
// which five pages are attached that receive every sample. The pages are processes of their own, as browsers are.
//   haptrace_view_ticks [PAIRS [SECONDS]]      default 10 pairs of 20 s
#include "base/statistics.h"
#include "devices/registry.h"
#include "player/record.h"
#include "player/record_controllers.h"
#include "tests/view/page_client.h"
#include "view/live_view.h"

#include <csignal>
#include <fmt/format.h>
#include <string>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

namespace {

using namespace haptrace;

constexpr int kPages = 5;

/// Receives everything until the view ends. Does not return.
[[noreturn]] void be_page(const std::string& address) {
  try {
    test::PageClient page(test::port_of(address));
    page.hello(test::token_of(address));
    page.send({{"type", "want"}, {"data", "samples"}});
    for (;;) (void)page.wait_for_binary(1);
  } catch (const std::exception&) {
  }
  _exit(0);
}

struct Times {
  double tick, latency;  ///< p99.9 [us]
};

Times run(double seconds, LiveView* view) {
  const auto device = open_device("sim:preset=falcon,hand=firm,seed=1");
  SessionOptions options;
  options.clock = ClockChoice::real;
  PassiveController passive;
  TimedController controller(passive, seconds);
  std::vector<SampleSink*> sinks;
  if (view != nullptr) {
    ViewedSession session;
    session.device = device->info();
    view->begin(session, {});
    sinks.push_back(&view->sink());
  }
  const SessionResult result =
      run_session(*device, controller, {}, sinks, options, StopRequest{}, [&](const SessionView& status) {
        if (view != nullptr) view->show(status);
      });
  if (view != nullptr) view->end(result);
  return {1e6 * result.servo.tick_time.quantile(0.999), 1e6 * result.servo.latency.quantile(0.999)};
}

}  // namespace

int main(int argc, char** argv) {
  const int pairs = argc > 1 ? std::stoi(argv[1]) : 10;
  const double seconds = argc > 2 ? std::stod(argv[2]) : 20;
  std::vector<double> tick_ratios, latency_ratios;
  fmt::print("p99.9 [us]   tick: without, with   wake-up: without, with\n");
  for (int pair = 0; pair < pairs; ++pair) {
    Times times[2]{};
    for (const int turn : {pair % 2, 1 - pair % 2}) {
      if (turn == 0) {
        times[0] = run(seconds, nullptr);
        continue;
      }
      LiveView view({});
      std::vector<pid_t> pages;
      for (int i = 0; i < kPages; ++i)
        if (const pid_t child = fork(); child == 0)
          be_page(view.address(ViewRole::therapist));
        else
          pages.push_back(child);
      while (view.pages() < kPages) usleep(1000);
      times[1] = run(seconds, &view);
      for (const pid_t page : pages) kill(page, SIGKILL);
      for (const pid_t page : pages) waitpid(page, nullptr, 0);
    }
    fmt::print("{:24.1f} {:7.1f} {:18.1f} {:7.1f}\n", times[0].tick, times[1].tick, times[0].latency, times[1].latency);
    tick_ratios.push_back(times[1].tick / times[0].tick);
    latency_ratios.push_back(times[1].latency / times[0].latency);
  }
  fmt::print("median ratio: tick {:.3f}, wake-up {:.3f}\n", median(tick_ratios), median(latency_ratios));
}
