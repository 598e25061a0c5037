#include "view/view_server.h"

#include "base/error.h"
#include "tests/support/errors.h"
#include "tests/support/real_time.h"
#include "tests/view/page_client.h"
#include "view/page_connection.h"

#include <atomic>
#include <boost/asio.hpp>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <memory>
#include <thread>
#include <zlib.h>

namespace haptrace {
namespace {

using test::http_bytes;
using test::http_get;
using test::HttpAnswer;
using test::PageClient;
using testing::HasSubstr;
using testing::Not;

std::string gzip(const std::string& text) {
  z_stream stream{};
  deflateInit2(&stream, 9, Z_DEFLATED, 15 + 16, 9, Z_DEFAULT_STRATEGY);
  std::string input = text, output(1000 + text.size(), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(input.data());
  stream.avail_in = static_cast<uInt>(input.size());
  stream.next_out = reinterpret_cast<Bytef*>(output.data());
  stream.avail_out = static_cast<uInt>(output.size());
  deflate(&stream, Z_FINISH);
  output.resize(stream.total_out);
  deflateEnd(&stream);
  return output;
}

/// Answers every ping, and counts.
struct Answering final : PageHandler {
  void joined(ViewPage& page, const PageMessage&) override {
    ++joins;
    page.send({{"type", "hello"}, {"role", to_string(page.role())}});
  }
  void left(ViewPage&) override { ++leaves; }
  void received(ViewPage& page, const PageMessage& message) override {
    if (message.type == PageMessage::Type::stop) ++stops;
    if (message.type == PageMessage::Type::ping) page.send({{"type", "pong"}, {"id", message.id}});
  }
  void steered(ViewPage&, const PageIntention& intention) override { grip = intention.grip; }

  std::atomic<int> joins{0}, leaves{0}, stops{0};
  std::atomic<double> grip{0};
};

const std::string kPage = "<!doctype html><title>stand-in</title>" + std::string(2000, ' ');
const std::string kCompressedPage = gzip(kPage);

class ViewServerTest : public testing::Test {
 protected:
  static ViewServer::Options options() {
    static const PageAsset kAssets[] = {{"/", "text/html; charset=utf-8", kCompressedPage, true},
                                        {"/app.js", "text/javascript; charset=utf-8", "let a = 1;", false}};
    return {.tokens = {{ViewRole::therapist, kTherapist}, {ViewRole::trainee, kTrainee}}, .assets = kAssets};
  }
  void serve(ViewServer::Options changed) {
    server = std::make_unique<ViewServer>(std::move(changed), handler);
    server->start();
  }
  void SetUp() override { serve(options()); }
  [[nodiscard]] std::uint16_t port() const { return server->port(); }
  [[nodiscard]] std::string host() const { return "127.0.0.1:" + std::to_string(port()); }

  /// Waits until the server's thread has done what it was to do.
  void settle() {
    server->run([] {});
  }

  static inline const std::string kTherapist = "00112233445566778899aabbccddeeff";
  static inline const std::string kTrainee = "ffeeddccbbaa99887766554433221100";
  Answering handler;
  std::unique_ptr<ViewServer> server;
};

TEST_F(ViewServerTest, EndsAlthoughAPageTakesNoGoodbye) {
  PageClient page(port());
  page.hello(kTherapist);
  page.wait_for("hello");
  // The page reads nothing from now on, as one that stands still in a debugger.
  server.reset();
  EXPECT_EQ(handler.joins, 1);
}

TEST_F(ViewServerTest, ThePageComesWithHeadersThatKeepOtherSitesAway) {
  const HttpAnswer answer = http_get(port(), "/");
  EXPECT_EQ(answer.status, 200U);
  EXPECT_EQ(answer.body, kPage);
  for (const char* header :
       {"Content-Type: text/html; charset=utf-8\r\n", "Content-Security-Policy: default-src 'self'; ",
        "frame-ancestors 'none'", "X-Content-Type-Options: nosniff\r\n", "Cache-Control: no-store\r\n",
        "Referrer-Policy: no-referrer\r\n", "Cross-Origin-Resource-Policy: same-origin\r\n",
        "Cross-Origin-Opener-Policy: same-origin\r\n"})
    EXPECT_THAT(answer.head, HasSubstr(header));
  EXPECT_THAT(answer.head, Not(HasSubstr("Access-Control")));
  EXPECT_EQ(http_get(port(), "/app.js").body, "let a = 1;");
}

TEST_F(ViewServerTest, AFileTravelsCompressedToAClientThatAcceptsIt) {
  const HttpAnswer answer = http_get(port(), "/", "Accept-Encoding: gzip, br\r\n");
  EXPECT_THAT(answer.head, HasSubstr("Content-Encoding: gzip\r\n"));
  EXPECT_EQ(answer.body, kCompressedPage);
}

TEST_F(ViewServerTest, HeadGivesTheHeadersAlone) {
  const HttpAnswer answer = http_get(port(), "/", "", "HEAD");
  EXPECT_EQ(answer.status, 200U);
  EXPECT_THAT(answer.head, HasSubstr("Content-Length: " + std::to_string(kPage.size())));
  EXPECT_EQ(answer.body, "");
}

TEST_F(ViewServerTest, OtherAddressesAndMethodsAreRefused) {
  EXPECT_EQ(http_get(port(), "/index.html").status, 404U);
  EXPECT_EQ(http_get(port(), "/../../etc/passwd").status, 404U);
  EXPECT_EQ(http_get(port(), "/", "", "POST").status, 405U);
  EXPECT_EQ(http_get(port(), "/", "", "DELETE").status, 405U);
  EXPECT_EQ(http_get(port(), "/", "", "OPTIONS").status, 405U);
  EXPECT_EQ(http_get(port(), "/ws").status, 400U);
}

TEST_F(ViewServerTest, ARequestForAReboundNameIsRefusedAlthoughItsOriginIsTheSame) {
  const std::string evil = "evil.test:" + std::to_string(port());
  EXPECT_EQ(http_get(port(), "/", "Host: " + evil + "\r\n").status, 403U);
  EXPECT_EQ(http_get(port(), "/", "Host: " + evil + "\r\nOrigin: http://" + evil + "\r\n").status, 403U);
  EXPECT_THROW(PageClient(port(), "http://" + evil, evil), std::runtime_error);
  EXPECT_EQ(http_bytes(port(), "GET / HTTP/1.1\r\n\r\n").status, 403U) << "without a Host";
  EXPECT_EQ(http_get(port(), "/", "Host: " + host() + "\r\nHost: " + evil + "\r\n").status, 403U);
}

TEST_F(ViewServerTest, AnotherSiteInTheSameBrowserIsRefused) {
  for (const char* origin : {"http://evil.test", "https://evil.test", "null", "http://127.0.0.1:1"}) {
    EXPECT_THROW(PageClient(port(), origin), std::runtime_error) << origin;
    EXPECT_EQ(http_get(port(), "/", std::string("Origin: ") + origin + "\r\n").status, 403U) << origin;
  }
}

TEST_F(ViewServerTest, EveryRoleHasItsTokenAndItsAddress) {
  EXPECT_EQ(server->address(ViewRole::trainee), "http://" + host() + "/#" + kTrainee);
  EXPECT_EQ(server->address(ViewRole::viewer), "");
  for (const auto& [token, role] : {std::pair(kTherapist, "therapist"), std::pair(kTrainee, "trainee")}) {
    PageClient page(port(), "http://" + host());
    page.hello(token);
    EXPECT_EQ(page.wait_for("hello")["role"], role);
  }
}

TEST_F(ViewServerTest, WithoutTheTokenNothingIsSentAndTheConnectionCloses) {
  std::string wrong = kTherapist;
  wrong.back() = '0';
  for (const std::string& token : {std::string(), wrong, kTherapist + "0", kTherapist.substr(1)}) {
    PageClient page(port());
    page.hello(token);
    EXPECT_EQ(page.wait_for_close(), 1008U) << token;
  }
  const std::vector<std::string> others{R"({"type":"stop"})", R"({"type":"ping"})", "", "garbage"};
  for (const std::string& first : others) {
    PageClient page(port());
    page.send_text(first);
    EXPECT_EQ(page.wait_for_close(), 1008U) << first;
  }
  PageClient page(port());
  page.intend(0, 0, 0, 1);
  EXPECT_EQ(page.wait_for_close(), 1008U);
  EXPECT_EQ(handler.joins, 0);
  EXPECT_EQ(handler.stops, 0);
  EXPECT_EQ(handler.grip, 0);
}

TEST_F(ViewServerTest, APageOfAnotherVersionIsRefused) {
  PageClient page(port());
  page.send({{"type", "hello"}, {"version", 2}, {"token", kTherapist}});
  EXPECT_EQ(page.wait_for_close(), 1008U);
}

TEST_F(ViewServerTest, ServesNobodyBeforeItsOwnerIsComplete) {
  server = std::make_unique<ViewServer>(options(), handler);
  std::thread early([at = port()] {
    PageClient page(at);
    page.hello(kTherapist);
    (void)page.wait_for("hello");
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  EXPECT_EQ(handler.joins, 0);
  server->start();
  early.join();
  EXPECT_EQ(handler.joins, 1);
}

TEST_F(ViewServerTest, EndsAlthoughItNeverStarted) {
  server = std::make_unique<ViewServer>(options(), handler);
  server.reset();
}

TEST_F(ViewServerTest, AConnectionThatSaysNothingIsClosed) {
  ViewServer::Options hasty = options();
  hasty.patience = std::chrono::milliseconds(50);
  serve(hasty);
  PageClient page(port());
  EXPECT_EQ(page.wait_for_close(), 0U);
  EXPECT_EQ(http_bytes(port(), "GET / HT").status, 0U) << "a request that does not end";
}

TEST_F(ViewServerTest, StrangersKeepNobodyOut) {
  ViewServer::Options patient = options();
  patient.patience = std::chrono::minutes(10);
  serve(patient);
  std::vector<std::unique_ptr<PageClient>> strangers;
  for (int i = 0; i < 150; ++i) strangers.push_back(std::make_unique<PageClient>(port()));
  PageClient page(port());
  page.hello(kTherapist);
  EXPECT_EQ(page.wait_for("hello")["role"], "therapist");
  EXPECT_EQ(http_get(port(), "/").status, 200U);
  EXPECT_EQ(strangers.front()->wait_for_close(), 0U) << "the first had to give way";
}

TEST_F(ViewServerTest, ALatePageTakesThePlaceOfTheOneThatWasSilentLongest) {
  ViewServer::Options few = options();
  few.most_pages = 2;
  serve(few);
  PageClient silent(port()), lively(port());
  silent.hello(kTherapist);
  (void)silent.wait_for("hello");
  lively.hello(kTherapist);
  (void)lively.wait_for("hello");
  PageClient late(port());
  late.hello(kTherapist);
  (void)late.wait_for("hello");
  EXPECT_EQ(silent.wait_for_close(), 1008U);
  lively.send({{"type", "ping"}, {"id", 3}});
  EXPECT_EQ(lively.wait_for("pong")["id"], 3);
}

TEST_F(ViewServerTest, TraineesPagesNeverTakeThePlaceOfATherapists) {
  ViewServer::Options few = options();
  few.most_pages = 2;
  serve(few);
  PageClient therapist(port()), first(port()), second(port());
  therapist.hello(kTherapist);
  (void)therapist.wait_for("hello");
  first.hello(kTrainee);
  (void)first.wait_for("hello");
  second.hello(kTrainee);
  (void)second.wait_for("hello");
  EXPECT_EQ(first.wait_for_close(), 1008U) << "though the therapist was silent for longer";
  PageClient colleague(port());
  colleague.hello(kTherapist);
  (void)colleague.wait_for("hello");
  EXPECT_EQ(second.wait_for_close(), 1008U);
  PageClient third(port());
  third.hello(kTrainee);
  EXPECT_EQ(third.wait_for_close(), 1008U) << "there is no place left but the therapists'";
  therapist.send({{"type", "ping"}, {"id", 3}});
  EXPECT_EQ(therapist.wait_for("pong")["id"], 3);
}

TEST(ViewServerPort, BelongsToNoOtherProgramOnEitherLoopbackAddress) {
  boost::asio::io_context io;
  const auto loopback = boost::asio::ip::address_v6::loopback();
  boost::system::error_code error;
  boost::asio::ip::tcp::acceptor other(io);
  other.open(boost::asio::ip::tcp::v6(), error);
  if (!error) other.bind({loopback, 0}, error);
  if (!error) other.listen(5, error);
  if (error) GTEST_SKIP() << "this machine has no IPv6";
  Answering nobody;
  const std::uint16_t port = other.local_endpoint().port();
  EXPECT_THAT(test::error_of([&] { ViewServer server({.port = port}, nobody); }),
              testing::HasSubstr(fmt::format("another program listens on port {} of ::1", port)));
}

TEST_F(ViewServerTest, AnOversizedMessageClosesTheConnection) {
  PageClient page(port());
  page.hello(kTherapist);
  (void)page.wait_for("hello");
  page.send_text(std::string(5000, ' '));
  EXPECT_EQ(page.wait_for_close(), 1009U);
}

TEST_F(ViewServerTest, AnOversizedRequestIsRefused) {
  EXPECT_EQ(http_get(port(), "/", "X: " + std::string(20'000, 'x') + "\r\n").status, 0U);
  EXPECT_EQ(http_get(port(), "/" + std::string(20'000, 'x')).status, 0U);
  EXPECT_NE(http_bytes(port(), "POST / HTTP/1.1\r\nHost: " + host() + "\r\nContent-Length: 1000000\r\n\r\n").status,
            200U);
  EXPECT_EQ(http_get(port(), "/").status, 200U) << "the server still serves";
}

TEST_F(ViewServerTest, GarbageCostsTheServerNothing) {
  std::string garbage;
  for (int i = 0; i < 4000; ++i) garbage += static_cast<char>(i * 7919 >> 3);
  EXPECT_EQ(http_bytes(port(), garbage).status, 0U);
  EXPECT_EQ(http_bytes(port(), "\r\n\r\n").status, 0U);
  PageClient page(port());
  page.hello(kTherapist);
  (void)page.wait_for("hello");
  for (const char* text : {"", "{", "\xff\xfe", R"({"type":7})", R"({"type":"bins","channels":{}})"})
    page.send_text(text);
  page.send_binary("");
  page.send_binary("\x08");
  page.send_binary(std::string(4000, '\xff'));
  page.send({{"type", "ping"}, {"id", 9}});
  // Text that is not UTF-8 is against the WebSocket protocol itself, and closes the connection.
  EXPECT_THAT(page.wait_for_close(), testing::AnyOf(1007U, 0U));
  PageClient next(port());
  next.hello(kTherapist);
  EXPECT_EQ(next.wait_for("hello")["role"], "therapist");
}

TEST_F(ViewServerTest, AFloodIsCutOffButAStopInItIsObeyed) {
  PageClient page(port());
  page.hello(kTherapist);
  (void)page.wait_for("hello");
  for (int i = 0; i < 2000 && handler.leaves == 0; ++i) page.send({{"type", "stop"}});
  EXPECT_EQ(page.wait_for_close(), 1008U);
  while (handler.leaves == 0) settle();  // the page may see the end before the handler does
  EXPECT_GE(handler.stops, 200);
  EXPECT_EQ(handler.leaves, 1);
}

TEST(MessageBucketTest, ItAllows240MessagesASecondOnAverageAndAsManyAtOnce) {
  MessageBucket bucket;
  MessageBucket::Clock::time_point now{std::chrono::hours(1)};
  int taken = 0;
  while (taken < 1000 && bucket.take(now)) ++taken;
  EXPECT_EQ(taken, 240);
  for (int i = 0; i < 10'000; ++i) {
    now += std::chrono::microseconds(4167);
    ASSERT_TRUE(bucket.take(now)) << i;
  }
  now += std::chrono::hours(1);
  taken = 0;
  while (taken < 1000 && bucket.take(now)) ++taken;
  EXPECT_EQ(taken, 240);
}

TEST_F(ViewServerTest, ASlowPageLosesDataAndIsToldSoWhileOthersGetEverything) {
  test::in_real_time();
  PageClient slow(port()), quick(port());
  for (PageClient* page : {&slow, &quick}) {
    page->hello(kTherapist);
    (void)page->wait_for("hello");
  }
  constexpr std::uint32_t kFrames = 200;
  for (std::uint32_t i = 1; i <= kFrames; ++i) {
    server->run([&] {
      const auto frame = std::make_shared<const Frame>(Frame{.rows = i, .body = std::string(100'000, 'x')});
      const auto pages = server->pages();
      for (const auto& page : pages) page->stream(frame);
    });
    const auto got = quick.wait_for_binary([](const test::BinaryMessage&) { return true; });
    EXPECT_EQ(got.rows, i);
    EXPECT_EQ(got.flags, 0);
    EXPECT_EQ(got.sequence, i);
  }
  // 20 MB are more than the sockets hold. What the slow page still gets ends with the newest frame, after a gap.
  std::uint32_t frames = 0, before = 0;
  bool gap = false;
  for (std::uint32_t last = 0; last != kFrames;) {
    const auto got = slow.wait_for_binary([](const test::BinaryMessage&) { return true; });
    EXPECT_EQ((got.flags & FrameFlags::kGap) != 0, got.rows != before + 1) << got.rows << " after " << before;
    gap = gap || got.flags != 0;
    EXPECT_EQ(got.sequence, ++frames);
    last = before = got.rows;
  }
  EXPECT_TRUE(gap);
  EXPECT_LT(frames, kFrames);
}

TEST_F(ViewServerTest, ControlMessagesAreNeverDroppedAndAPageThatDoesNotTakeThemIsClosed) {
  PageClient page(port());
  page.hello(kTherapist);
  (void)page.wait_for("hello");
  const std::string words(10'000, 'w');
  std::size_t sent = 0;
  while (handler.leaves == 0 && sent < 10'000) {
    server->run([&] {
      const auto pages = server->pages();
      for (const auto& known : pages) known->send({{"type", "words"}, {"number", sent}, {"words", words}});
    });
    ++sent;
  }
  EXPECT_EQ(handler.leaves, 1) << "a megabyte more than the sockets hold was not taken";
  for (std::size_t i = 0; i + 200 < sent; ++i) ASSERT_EQ(page.wait_for("words")["number"], i);
}

TEST_F(ViewServerTest, AnAnswerIsNotDroppedAndPrecedesLiveData) {
  PageClient page(port());
  page.hello(kTherapist);
  (void)page.wait_for("hello");
  server->run([&] {
    const auto pages = server->pages();
    for (std::uint32_t i = 0; i < 100; ++i)
      pages.front()->stream(std::make_shared<const Frame>(Frame{.rows = i, .body = std::string(100'000, 'x')}));
    pages.front()->answer({.request = 77, .body = std::string(3'000'000, 'y')});
    EXPECT_TRUE(pages.front()->is_busy());
  });
  EXPECT_EQ(page.wait_for_answer(77).body.size(), 3'000'000U);
  (void)page.wait_for_binary([](const test::BinaryMessage& message) { return message.rows == 99; });
  server->run([&] { EXPECT_FALSE(server->pages().front()->is_busy()); });
}

TEST_F(ViewServerTest, PagesThatDisconnectAreForgotten) {
  for (int i = 0; i < 20; ++i) {
    PageClient page(port());
    page.hello(kTherapist);
    (void)page.wait_for("hello");
    page.disconnect();
  }
  while (handler.leaves < 20) settle();
  server->run([&] { EXPECT_TRUE(server->pages().empty()); });
}

TEST_F(ViewServerTest, ThePagesHearThatTheSessionIsOverWhenTheServerEnds) {
  PageClient page(port());
  page.hello(kTherapist);
  (void)page.wait_for("hello");
  std::thread ending([&] { server.reset(); });
  EXPECT_EQ(page.wait_for_close(), 1001U);
  ending.join();
}

TEST_F(ViewServerTest, APortThatIsTakenIsReported) {
  ViewServer::Options same = options();
  same.port = port();
  EXPECT_THAT(test::error_of([&] { ViewServer(same, handler); }),
              HasSubstr("another program listens on port " + std::to_string(port())));
}

}  // namespace
}  // namespace haptrace
