#include "view/recording_view.h"

#include "base/error.h"
#include "formats/recording/recording.h"
#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"
#include "tests/view/page_client.h"

#include <filesystem>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <thread>

namespace haptrace {
namespace {

using test::PageClient;
using test::TempFolder;

class RecordingViewTest : public testing::Test {
 protected:
  /// Writes a recording of `count` rows of 1 ms with x = offset + row, and returns its file. Runs and holds alternate,
  /// with as many rows as `stretch`.
  std::string write(const std::string& name, int count, double offset = 0, std::size_t stretch = 1'000'000) {
    RecordingHeader header;
    header.title = "title of " + name;
    RecordingWriter writer(folder / name, header, {}, {});
    std::vector<Sample> rows(static_cast<std::size_t>(count));
    for (std::size_t i = 0; i < rows.size(); ++i) {
      rows[i].tick = i;
      rows[i].time_ns = static_cast<std::int64_t>(i) * 1'000'000;
      rows[i].position = Vec3(offset + static_cast<double>(i), 0, 0);
      rows[i].velocity = Vec3::Zero();
      rows[i].phase = i / stretch % 2 == 0 ? Phase::run : Phase::hold;
    }
    writer.append(rows);
    writer.finish();
    return folder / name;
  }

  std::unique_ptr<PageClient> join(const RecordingView& view) {
    auto page = std::make_unique<PageClient>(test::port_of(view.address()));
    page->hello(test::token_of(view.address()));
    greeting = page->wait_for("hello");
    return page;
  }

  TempFolder folder;
  nlohmann::json greeting;
};

TEST_F(RecordingViewTest, APageSeesARecordingAndItsRows) {
  const RecordingView view({write("a.h5", 3000)}, {});
  const auto page = join(view);
  EXPECT_EQ(greeting["role"], "viewer");
  EXPECT_EQ(greeting["live"], false);
  EXPECT_EQ(greeting["control"], false);
  EXPECT_EQ(greeting["recordings"].size(), 1U);
  EXPECT_EQ(greeting["recordings"][0]["name"], "a.h5");
  EXPECT_NEAR(greeting["recordings"][0]["duration"].get<double>(), 2.999, 1e-9);
  EXPECT_EQ(page->wait_for("recording")["title"], "title of a.h5");
  EXPECT_EQ(page->wait_for("events")["reset"], true);
  EXPECT_EQ(page->wait_for("phases")["done"], true);
  EXPECT_EQ(page->wait_for_binary(4).rows, 0U);
  page->send({{"type", "rows"}, {"id", 5}, {"t0", 1}, {"t1", 1.5}});
  const test::BinaryMessage rows = page->wait_for_answer(5);
  EXPECT_EQ(rows.rows, 501U);
  EXPECT_EQ(rows.sent, 0);
  EXPECT_EQ(rows.plane(1)[0], 1000);
  page->send({{"type", "bins"}, {"id", 6}, {"t0", 0}, {"t1", 3}, {"pixels", 3}, {"channels", {"x", "force"}}});
  const test::DecodedBins bins = test::decode_bins(page->wait_for_answer(6));
  EXPECT_EQ(bins.width, 1.024);
  EXPECT_THAT(bins.channels[0].max, testing::ElementsAre(1023, 2047, 2999));
  page->send({{"type", "ping"}, {"id", 7}, {"sent", 12.5}});
  EXPECT_EQ(page->wait_for("pong")["sent"], 12.5);
}

TEST_F(RecordingViewTest, PagesLookAtDifferentRecordingsOfASession) {
  std::vector<std::string> files;
  for (int i = 0; i < 7; ++i) files.push_back(write("trial" + std::to_string(i) + ".h5", 1000, 10'000.0 * i));
  const RecordingView view(files, {});
  const auto first = join(view), second = join(view);
  EXPECT_EQ(greeting["recordings"].size(), 7U);
  EXPECT_EQ(greeting["recordings"][6]["title"], "title of trial6.h5");
  for (const int index : {6, 2, 0, 5}) {
    second->send({{"type", "open"}, {"id", 3}, {"recording", index}});
    EXPECT_EQ(second->wait_for("recording", [&](const auto& said) { return said["index"] == index; })["name"],
              "trial" + std::to_string(index) + ".h5");
    const auto id = static_cast<std::uint32_t>(100 + index);
    for (PageClient* page : {second.get(), first.get()})
      page->send({{"type", "rows"}, {"id", id}, {"t0", 0}, {"t1", 0.01}});
    EXPECT_EQ(second->wait_for_answer(id).plane(1)[0], 10'000 * index);
    EXPECT_EQ(first->wait_for_answer(id).plane(1)[0], 0);
  }
  second->send({{"type", "open"}, {"id", 4}, {"recording", 7}});
  EXPECT_EQ(second->wait_for("error")["id"], 4);
}

TEST_F(RecordingViewTest, APageIsWarnedOfARecordingThatIsStillWritten) {
  RecordingWriter writer(folder / "a.h5", {}, {}, {});
  writer.append(std::vector<Sample>(10));
  writer.flush();
  const RecordingView view({folder / "a.h5"}, {});
  const nlohmann::json warning = join(view)->wait_for("warning");
  EXPECT_EQ(warning["code"], "unfinished");
  EXPECT_EQ(warning["severity"], "warning");
  writer.finish();
}

TEST_F(RecordingViewTest, ThePhasesOfALongRecordingComeInPiecesAndKeepNoAnswerWaiting) {
  const RecordingView view({write("long.h5", 600'000, 0, 10'000), write("short.h5", 10)}, {});
  const auto page = join(view);
  page->send({{"type", "rows"}, {"id", 5}, {"t0", 500}, {"t1", 500.1}});
  EXPECT_EQ(page->wait_for_answer(5).rows, 101U);
  std::vector<nlohmann::json> stretches;
  for (bool done = false; !done;) {
    const nlohmann::json phases = page->wait_for("phases");
    EXPECT_EQ(phases["reset"], stretches.empty());
    for (const nlohmann::json& stretch : phases["list"]) stretches.push_back(stretch);
    done = phases["done"];
  }
  ASSERT_EQ(stretches.size(), 60U);
  for (std::size_t i = 0; i < stretches.size(); ++i) {
    EXPECT_EQ(stretches[i][2], i % 2 == 0 ? "run" : "hold");
    EXPECT_EQ(stretches[i][0], 10.0 * static_cast<double>(i));
  }
}

TEST_F(RecordingViewTest, AFileThatCannotBeReadIsReportedWhenItIsOpened) {
  const std::string good = write("good.h5", 10), bad = folder.write("bad.h5", "not a recording");
  const RecordingView view({good, bad}, {});
  const auto page = join(view);
  page->send({{"type", "open"}, {"id", 4}, {"recording", 1}});
  const nlohmann::json error = page->wait_for("error");
  EXPECT_EQ(error["id"], 4);
  EXPECT_THAT(error["text"].get<std::string>(), testing::HasSubstr("bad.h5"));
  EXPECT_NE(test::error_of([&] { RecordingView({bad}, {}); }), "no error");
  EXPECT_NE(test::error_of([] { RecordingView({}, {}); }), "no error");
}

TEST_F(RecordingViewTest, ARecordingThatDisappearsCostsOnlyItsAnswers) {
  std::vector<std::string> files;
  for (int i = 0; i < 7; ++i) files.push_back(write("trial" + std::to_string(i) + ".h5", 1000));
  const RecordingView view(files, {});
  const auto page = join(view);
  std::filesystem::remove(files[6]);
  page->send({{"type", "open"}, {"id", 4}, {"recording", 6}});
  page->send({{"type", "open"}, {"id", 5}, {"recording", 1}});
  EXPECT_EQ(page->wait_for("recording", [](const auto& said) { return said["index"] == 1; })["name"], "trial1.h5");
}

TEST_F(RecordingViewTest, RequestsOfAPageThatLeavesAreHarmless) {
  const RecordingView view({write("long.h5", 400'000)}, {});
  for (int i = 0; i < 20; ++i) {
    const auto page = join(view);
    for (std::uint32_t id = 1; id < 50; ++id)
      page->send(
          {{"type", "bins"}, {"id", id}, {"t0", 0}, {"t1", 400}, {"pixels", 2000}, {"channels", {"x", "y", "z"}}});
    page->disconnect();
  }
  const auto page = join(view);
  page->send({{"type", "bins"}, {"id", 1}, {"t0", 0}, {"t1", 400}, {"pixels", 2}, {"channels", {"x"}}});
  EXPECT_EQ(page->wait_for_answer(1).kind, 3);
}

TEST_F(RecordingViewTest, NothingOfALiveSessionWorksInARecording) {
  const RecordingView view({write("a.h5", 10)}, {});
  const auto page = join(view);
  page->send({{"type", "stop"}});
  page->send({{"type", "command"}, {"id", 1}, {"line", "kp 1"}});
  page->send({{"type", "shown"}, {"what", "go"}});
  page->intend(0, 0, 0, 1);
  page->send({{"type", "ping"}, {"id", 2}, {"sent", 0}});
  EXPECT_EQ(page->wait_for("pong")["id"], 2);
  EXPECT_EQ(view.pages(), 1U);
}

}  // namespace
}  // namespace haptrace
