// The control socket, by clients on real sockets: good ones, several, and those that send garbage, stall or vanish.
#include "player/tuning_server.h"

#include "tests/support/errors.h"

#include <boost/asio.hpp>
#include <chrono>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <thread>

namespace haptrace {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using test::error_of;
using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

const Tuning kServed{.gains = {Vec3::Constant(1000), Vec3::Constant(10)}};

/// A client that waits for what it asks.
class Client {
 public:
  explicit Client(std::uint16_t port, const std::string& address = "127.0.0.1") : socket_(io_) {
    socket_.connect({asio::ip::make_address(address), port});
  }

  void send(std::string_view text) { asio::write(socket_, asio::buffer(text)); }

  /// The next line; "closed" when there is none any more.
  std::string line() {
    boost::system::error_code error;
    const std::size_t size = asio::read_until(socket_, asio::dynamic_buffer(received_), '\n', error);
    if (error) return "closed";
    std::string text = received_.substr(0, size - 1);
    received_.erase(0, size);
    return text;
  }

  std::string ask(const std::string& command) {
    send(command + "\n");
    return line();
  }

  tcp::socket& socket() { return socket_; }

 private:
  asio::io_context io_;
  tcp::socket socket_;
  std::string received_;
};

class TuningServerTest : public testing::Test {
 protected:
  LiveTuning tuning{kServed,
                    {.limits = {.largest = {Vec3::Constant(5200), Vec3::Constant(60)}, .because = "the device bears"}}};
  TuningServer server{tuning, 0};
};

TEST_F(TuningServerTest, ObeysALineAndAnswersALine) {
  Client client(server.port());
  EXPECT_EQ(client.ask("kp 2000"), "ok kp 2000 2000 2000");
  EXPECT_EQ(tuning.wanted().gains.kp, Vec3::Constant(2000));
  EXPECT_EQ(client.ask("kp 9000\r"), "ok kp 5200 5200 5200 clamped from 9000: the device bears 5200");
  EXPECT_THAT(client.ask("kq 1"), AllOf(StartsWith("error "), HasSubstr("'kp'")));
  EXPECT_EQ(nlohmann::json::parse(client.ask("get"))["kp"][0], 5200);
  EXPECT_EQ(client.ask("quit"), "ok bye");
  EXPECT_EQ(client.line(), "closed");
}

TEST_F(TuningServerTest, ListensOnTheLoopbackAlone) {
  EXPECT_GT(server.port(), 0);
  asio::io_context io;
  boost::system::error_code no_ipv6;
  tcp::socket probe(io);
  if (!probe.connect({asio::ip::address_v6::loopback(), server.port()}, no_ipv6)) {
    EXPECT_EQ(Client(server.port(), "::1").ask("get kd"), "ok kd 10 10 10");
  }

  // Every other address of this machine refuses: on Linux 127.0.0.2 is one, whatever the network.
  tcp::socket other(io);
  boost::system::error_code refused;
  (void)other.connect({asio::ip::make_address("127.0.0.2"), server.port()}, refused);
  EXPECT_EQ(refused, asio::error::connection_refused);
}

TEST_F(TuningServerTest, ServesSeveralClientsThatSeeOneTuning) {
  Client a(server.port()), b(server.port()), c(server.port());
  a.send("kp 1100\n");
  EXPECT_EQ(a.line(), "ok kp 1100 1100 1100");
  EXPECT_EQ(b.ask("get kp"), "ok kp 1100 1100 1100");
  EXPECT_EQ(c.ask("gains * 2"), "ok kp 2200 2200 2200 kd 20 20 20");
  EXPECT_EQ(a.ask("kd"), "ok kd 20 20 20");
}

TEST_F(TuningServerTest, AnswersInOrderWhatCameAtOnceAndInPieces) {
  Client client(server.port());
  client.send("kp 1\n\r\n\nkp 2\nkp");
  EXPECT_EQ(client.line(), "ok kp 1 1 1");
  EXPECT_EQ(client.line(), "ok kp 2 2 2");
  client.send(" 3\nget k");
  EXPECT_EQ(client.line(), "ok kp 3 3 3");
  client.send("p\n");
  EXPECT_EQ(client.line(), "ok kp 3 3 3");
}

TEST_F(TuningServerTest, TakesNoCommandWhoseLineDidNotEnd) {
  Client client(server.port());
  client.send("kd 5\nkp 20");
  client.socket().shutdown(tcp::socket::shutdown_send);
  EXPECT_EQ(client.line(), "ok kd 5 5 5") << "what came whole before the end is answered";
  EXPECT_EQ(client.line(), "closed");
  EXPECT_EQ(tuning.wanted().gains.kp, kServed.gains.kp);
}

TEST_F(TuningServerTest, RefusesGarbageAndGoesOn) {
  Client client(server.port());
  for (const std::string& garbage :
       {std::string("\x00\xff\xfe\x01", 4), std::string(256, 'x'), std::string("kp 1e999"), std::string("\x1b]0;x\x07"),
        std::string("; rm -rf /"), std::string("get ../..")}) {
    const std::string answer = client.ask(garbage);
    EXPECT_THAT(answer, StartsWith("error "));
    for (const char c : answer) EXPECT_TRUE(c >= ' ' && c <= '~');
  }
  EXPECT_EQ(client.ask("get kp"), "ok kp 1000 1000 1000");
}

TEST_F(TuningServerTest, RefusesALongLineOnceAndKeepsNothingOfIt) {
  Client client(server.port());
  client.send(std::string(1U << 20U, 'k'));
  EXPECT_THAT(client.line(), AllOf(StartsWith("error "), HasSubstr("256 bytes"))) << "at once, without the line's end";
  client.send(std::string(1U << 20U, 'k') + " kp 7\nkp 1500\n");
  EXPECT_EQ(client.line(), "ok kp 1500 1500 1500");
  EXPECT_THAT(client.ask(std::string(300, 'k')), HasSubstr("256 bytes"));
  EXPECT_EQ(client.ask("get kp"), "ok kp 1500 1500 1500");
}

TEST_F(TuningServerTest, TurnsAWebBrowserAwayBeforeItsBodyIsRead) {
  Client client(server.port());
  client.send("POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\nkp 5000\r\n");
  EXPECT_THAT(client.line(), StartsWith("error "));
  EXPECT_EQ(client.line(), "closed");
  EXPECT_EQ(tuning.wanted().gains.kp, kServed.gains.kp);
}

TEST_F(TuningServerTest, IsNotHeldUpByClientsThatNeverReadOrVanish) {
  std::vector<std::unique_ptr<Client>> silent;
  for (int i = 0; i < 5; ++i) {
    silent.push_back(std::make_unique<Client>(server.port()));
    // As much as the system takes: the server neither reads on nor keeps answers for it.
    tcp::socket& socket = silent.back()->socket();
    socket.non_blocking(true);
    boost::system::error_code full;
    std::string commands;
    while (commands.size() < 65536) commands += "get\n";
    for (int n = 0; n < 64 && !full; ++n) asio::write(socket, asio::buffer(commands), full);
  }
  for (int i = 0; i < 3; ++i) {
    Client vanishing(server.port());
    vanishing.send("get\nget\nget\n");
    vanishing.socket().set_option(asio::socket_base::linger(true, 0));  // reset, not closed
  }
  Client client(server.port());
  EXPECT_EQ(client.ask("kp 1234"), "ok kp 1234 1234 1234");
}

TEST_F(TuningServerTest, TakesSixteenClientsAndTheNextWhenOneLeaves) {
  std::vector<std::unique_ptr<Client>> clients;
  for (int i = 0; i < 16; ++i) {
    clients.push_back(std::make_unique<Client>(server.port()));
    EXPECT_EQ(clients.back()->ask("get kp"), "ok kp 1000 1000 1000");
  }
  Client refused(server.port());
  EXPECT_THAT(refused.line(), AllOf(StartsWith("error "), HasSubstr("16 clients")));
  EXPECT_EQ(refused.line(), "closed");
  EXPECT_EQ(clients.back()->ask("quit"), "ok bye");
  EXPECT_EQ(clients.back()->line(), "closed");
  EXPECT_EQ(Client(server.port()).ask("get kp"), "ok kp 1000 1000 1000");
}

TEST(TuningServer, EndsWithItsObjectWhileClientsAreConnected) {
  LiveTuning tuning(kServed, {});
  auto server = std::make_unique<TuningServer>(tuning, 0);
  const std::uint16_t port = server->port();
  Client idle(port), waiting(port);
  EXPECT_EQ(idle.ask("get kp"), "ok kp 1000 1000 1000");
  server.reset();
  EXPECT_EQ(idle.line(), "closed");
  EXPECT_EQ(waiting.line(), "closed");
  EXPECT_ANY_THROW(Client{port});
  EXPECT_EQ(TuningServer(tuning, port).port(), port) << "the port is free again at once";
}

TEST(TuningServer, SaysThatAPortIsTaken) {
  LiveTuning tuning(kServed, {});
  const TuningServer first(tuning, 0);
  EXPECT_THAT(error_of([&] { TuningServer second(tuning, first.port()); }),
              AllOf(HasSubstr(std::to_string(first.port())), HasSubstr("0 for any free one")));
}

TEST(TuningPort, IsAPortOfTheLoopbackAndNothingElse) {
  for (const char* text : {"5005", "127.0.0.1:5005", "localhost:5005", "[::1]:5005"})
    EXPECT_EQ(parse_tuning_port(text), 5005) << text;
  for (const char* text : {"0.0.0.0:5005", "192.168.1.2:5005", "[::]:5005", "::1", "65536", "-1", "", "5005x", "lab:5",
                           "127.0.0.1:", "127.0.0.1:localhost:5"})
    EXPECT_THAT(error_of([&] { (void)parse_tuning_port(text); }), HasSubstr("this machine alone")) << text;
}

}  // namespace
}  // namespace haptrace
