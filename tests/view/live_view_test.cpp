#include "view/live_view.h"

#include "base/error.h"
#include "devices/loop/clock.h"
#include "devices/registry.h"
#include "formats/recording/recording.h"
#include "player/record.h"
#include "tests/support/temp_folder.h"
#include "tests/view/page_client.h"
#include "view/view_channels.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::BinaryMessage;
using test::PageClient;
using test::port_of;
using test::TempFolder;
using test::token_of;

/// A page of a role that has shown its token.
struct JoinedPage : PageClient {
  JoinedPage(const LiveView& view, ViewRole role, const char* wants = "none")
      : PageClient(port_of(view.address(role))) {
    hello(token_of(view.address(role)));
    greeting = wait_for("hello");
    send({{"type", "want"}, {"data", wants}});
    // Messages are obeyed in order, so the wish is known when the answer is here.
    send({{"type", "ping"}, {"id", 1}, {"sent", 0}});
    (void)wait_for("pong");
  }
  nlohmann::json greeting;
};

ViewedSession session_of(const Device& device) {
  ViewedSession session;
  session.name = "recorded.h5";
  session.title = "a title";
  session.verb = "record";
  session.device = device.info();
  session.virtual_time = device.info().virtual_time;
  session.max_force = 3;
  return session;
}

constexpr const char* kSimulated = "sim:preset=falcon,hand=firm,seed=1";

TEST(LiveView, APageSeesEverySampleThatTheFileHolds) {
  const TempFolder folder;
  LiveView view({});
  JoinedPage page(view, ViewRole::therapist, "samples");
  const auto device = open_device(kSimulated);
  RecordOptions options;
  options.duration = 0.5;
  options.session.loop.realtime = false;
  options.session.clock = ClockChoice::real;
  options.session.recording.emplace();
  options.session.recording->file = folder / "recorded.h5";
  SampleSink* const sinks[] = {&view.sink()};
  PassiveController passive;
  TimedController controller(passive, options.duration);
  view.begin(session_of(*device), {});
  StopRequest stop;
  const SessionResult result = run_session(*device, controller, {}, sinks, options.session, stop,
                                           [&](const SessionView& status) { view.show(status); });
  view.end(result);

  const RecordingReader reader(folder / "recorded.h5");
  const std::vector<Sample> samples = reader.read(0, reader.rows());
  ASSERT_GT(samples.size(), 400U);
  const ViewChannels channels(reader.columns());
  std::vector<float> values(channels.size());
  std::size_t row = 0;
  while (row < samples.size()) {
    const BinaryMessage batch = page.wait_for_binary(1);
    EXPECT_EQ(batch.flags, 0);
    ASSERT_EQ(batch.body.size(), 4 * batch.rows * (channels.size() + 1));
    std::vector<std::vector<float>> planes;
    for (std::size_t plane = 0; plane <= channels.size(); ++plane) planes.push_back(batch.plane(plane));
    for (std::uint32_t i = 0; i < batch.rows; ++i, ++row) {
      ASSERT_LT(row, samples.size());
      EXPECT_NEAR(batch.t0 + static_cast<double>(planes[0][i]), 1e-9 * static_cast<double>(samples[row].time_ns), 1e-8);
      channels.fill(samples[row], values);
      for (std::size_t c = 0; c < channels.size(); ++c)
        ASSERT_TRUE(planes[c + 1][i] == values[c] || (std::isnan(values[c]) && std::isnan(planes[c + 1][i])))
            << channels[c].name << " in row " << row;
    }
  }
  const nlohmann::json status =
      page.wait_for("status", [](const nlohmann::json& said) { return said["ended"] == true; });
  EXPECT_EQ(status["reason"], "finished");
  EXPECT_EQ(status["lost_rows"], 0);
}

TEST(LiveView, APageOfEachRoleStopsASessionWithoutPermissionToControlIt) {
  LiveView view({});
  for (const ViewRole role : {ViewRole::therapist, ViewRole::trainee}) {
    JoinedPage page(view, role);
    EXPECT_EQ(page.greeting["control"], false);
    StopRequest stop;
    const auto device = open_device(kSimulated);
    view.begin(session_of(*device), {.stop = &stop});
    page.send({{"type", "stop"}, {"id", "not a number"}});
    page.send({{"type", "ping"}, {"id", 2}, {"sent", 0}});
    (void)page.wait_for("pong");
    EXPECT_EQ(stop.count(), 2);
    view.abandon("over");
  }
}

}  // namespace
}  // namespace haptrace
