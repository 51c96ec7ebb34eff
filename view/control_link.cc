#include "view/control_link.h"

#include <chrono>
#include <memory>
#include <system_error>
#include <utility>

#include <boost/asio/post.hpp>

#include "daemon/control/socket_place.h"
#include "tools/control_client.h"

namespace waymark::view {
namespace {

using io::Json;

std::string failure(const std::string& reason) {
  return Json{{"type", "answer"}, {"ok", false}, {"error", reason}}.dump(
      -1, ' ', false, Json::error_handler_t::replace);
}

// What a page has use for.
Json shortStatus(const Json& reply) {
  Json status = Json::object();
  for (const char* key : {"map", "recorder", "log_level"}) {
    if (reply.contains(key)) status[key] = reply[key];
  }
  // It would be another one every time.
  if (status.contains("map") && status["map"].is_object()) status["map"].erase("last_save_age_s");
  return status;
}

}  // namespace

Result<Json> requestOf(const std::string& command) {
  const Result<Json> parsed = io::parseJson(command, "command");
  if (!parsed) return parsed.error();
  const auto name = parsed->is_object() ? parsed->find("command") : parsed->end();
  if (!parsed->is_object() || parsed->size() != 1 || name == parsed->end() || !name->is_string()) {
    return Error{"a command is {\"command\": NAME}"};
  }
  Json request = Json::object();
  for (const char* plain : {"save-map", "load-map", "reset"}) {
    if (*name == plain) request["command"] = plain;
  }
  for (const char* action : {"start", "stop"}) {
    if (*name != std::string("record-") + action) continue;
    request["command"] = "record";
    request["action"] = action;
  }
  if (request.empty()) return Error{"there is no such command"};
  return request;
}

ControlLink::ControlLink(boost::asio::io_context& io, std::filesystem::path socket,
                         LiveState& state)
    : io_(io), socket_(std::move(socket)), state_(state), pause_(io) {}

ControlLink::~ControlLink() {
  asker_.stop();
  asker_.join();
}

Result<Json> ControlLink::ask(const Json& request, int timeout_s) const {
  const auto timeout = std::chrono::seconds(timeout_s);
  if (!socket_.empty()) return tools::askDaemon(socket_, request, timeout);
  for (const std::filesystem::path& place : daemon::usualSockets()) {
    std::error_code error;
    if (std::filesystem::is_socket(place, error)) return tools::askDaemon(place, request, timeout);
  }
  return Error{"no daemon listens on a control socket"};
}

void ControlLink::askStatus() {
  const bool looked_at = looked_at_ && looked_at_();
  boost::asio::post(asker_, [this, looked_at] {
    // Good for some seconds, and asked for again until then.
    if (looked_at) (void)ask({{"command", "preview"}}, 2);
    const Result<Json> reply = ask({{"command", "status"}}, 2);
    Json status = reply && reply->value("ok", false) ? shortStatus(*reply) : Json();
    boost::asio::post(io_, [this, status = std::move(status)]() mutable {
      state_.setControl(std::move(status));
      pause_.expires_after(std::chrono::seconds(1));
      pause_.async_wait([this](const boost::system::error_code& stopped) {
        if (!stopped) askStatus();
      });
    });
  });
}

void ControlLink::command(const std::string& text, std::function<void(std::string)> answer) {
  const Result<Json> request = requestOf(text);
  if (!request) return answer(failure(request.error().message));
  boost::asio::post(asker_, [this, request = *request, answer = std::move(answer)]() mutable {
    const Result<Json> reply = ask(request, 60);
    std::string line;
    if (!reply) {
      line = failure(reply.error().message);
    } else {
      Json told = *reply;
      told["type"] = "answer";
      told["command"] = request["command"];
      line = told.dump(-1, ' ', false, Json::error_handler_t::replace);
    }
    boost::asio::post(io_, [answer = std::move(answer), line = std::move(line)]() mutable {
      answer(std::move(line));
    });
  });
}

}  // namespace waymark::view
