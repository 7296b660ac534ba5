// SPDX-License-Identifier: GPL-3.0-or-later
//
// hydro-stonefish: one vehicle in Stonefish, without a window, told what to do line by line.
//
//     hydro-stonefish SCENARIO.scn
//
// It says what it is, and then answers every line of its input with one line:
//
//     hydro-stonefish 1 VERSION TICKS_PER_SECOND THRUSTERS
//     reset x y z qw qx qy qz u v w p q r   ->  row x y z qw qx qy qz u v w p q r fx fy fz T1 ... Tn
//     hold TICKS s1 ... sn                  ->  row ... after so many ticks under these setpoints
//
// Pose of the body's origin O in NED, its velocity over ground in body axes (FRD), the specific force at O in body
// axes, mean over the last tick, and thrusts [N]. `reset` begins everything anew with rotors at rest. At the end of
// the input it ends. What is wrong is said in a line `error ...`, and ends it as well.
//
// The scenario is Stonefish's own, with one robot (algorithm "general") and a further element for this program:
//
//     <hydro rate="500" gravity="9.81"><buoyancy force="1485.75" moment="29.7 0 -29.7"/></hydro>
//
// Stonefish takes buoyancy from the mesh; here it is what the vehicle's file says: `force` B [N], and `moment` B r of
// its centre r from O [N m]. The difference acts beside Stonefish's own, wherever the vehicle is.

#include <cmath>
#include <cstdio>
#include <exception>
#include <iostream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <fcntl.h>
#include <unistd.h>

#include <actuators/LinkActuator.h>
#include <actuators/Thruster.h>
#include <core/Console.h>
#include <core/ConsoleSimulationApp.h>
#include <core/Robot.h>
#include <core/ScenarioParser.h>
#include <core/SimulationManager.h>
#include <entities/SolidEntity.h>
#include <entities/forcefields/Ocean.h>
#include <version.h>

namespace
{

constexpr int PROTOCOL = 1;

struct Settings
{
    double rate = 500.0;
    double gravity = 9.81;
    double buoyancy = 0.0;
    sf::Vector3 moment = sf::Vector3(0, 0, 0);
};

// What the file's buoyancy has beyond the mesh's: a force up and its moment, in every tick.
class Trim : public sf::LinkActuator
{
public:
    Trim(double force, const sf::Vector3& moment) : sf::LinkActuator("hydro/Trim"), force_(force), moment_(moment) {}

    sf::ActuatorType getType() const override
    {
        return sf::ActuatorType::PUSH;
    }

    void Update(sf::Scalar dt) override
    {
        sf::Actuator::Update(dt);
        const sf::Matrix3 toWorld = attach->getOTransform().getBasis();
        const sf::Vector3 up(0, 0, -1);
        const sf::Vector3 lever = attach->getCG2OTransform().inverse().getOrigin();
        attach->ApplyCentralForce(force_ * up);
        attach->ApplyTorque((toWorld * (moment_ - force_ * lever)).cross(up));
    }

private:
    double force_;
    sf::Vector3 moment_;
};

class World : public sf::SimulationManager
{
public:
    World(const std::string& scenario, const Settings& settings)
        : sf::SimulationManager(settings.rate), scenario_(scenario), settings_(settings)
    {
    }

    void BuildScenario() override
    {
        sf::ScenarioParser parser(this);
        if (!parser.Parse(scenario_))
            throw std::runtime_error("Stonefish does not take the scenario: " + lastWord(parser.getLog()));
        sf::SimulationApp::getApp()->setMaxPhysicsThreads(1);
        setGravity(settings_.gravity);
        if (getOcean() == nullptr)
            throw std::runtime_error("the scenario has no ocean");
        getOcean()->EnableCurrents();
        sf::Robot* robot = getRobot(0U);
        if (robot == nullptr || robot->getLink(0)->getRigidBody() == nullptr)
            throw std::runtime_error("the scenario has no robot with the algorithm \"general\"");
        body_ = robot->getLink(0);
        thrusters_.clear();
        for (size_t i = 0; sf::Actuator* one = robot->getActuator(i); ++i)
            if (one->getType() == sf::ActuatorType::THRUSTER)
                thrusters_.push_back(static_cast<sf::Thruster*>(one));
        addTrim();
    }

    sf::SolidEntity& body()
    {
        return *body_;
    }

    const std::vector<sf::Thruster*>& thrusters() const
    {
        return thrusters_;
    }

private:
    static std::string lastWord(const std::vector<sf::ConsoleMessage>& log)
    {
        for (auto line = log.rbegin(); line != log.rend(); ++line)
            if (line->type == sf::MessageType::ERROR)
                return line->text;
        return "no reason given";
    }

    void addTrim()
    {
        const double density = getOcean()->getLiquid().density;
        const double ofMesh = body_->getVolume() * density * settings_.gravity;
        const sf::Vector3 center = body_->getCG2OTransform().inverse() * body_->getCB();
        Trim* trim = new Trim(settings_.buoyancy - ofMesh, settings_.moment - ofMesh * center);
        trim->AttachToSolid(body_, sf::I4());
        AddActuator(trim);
    }

    std::string scenario_;
    Settings settings_;
    sf::SolidEntity* body_ = nullptr;
    std::vector<sf::Thruster*> thrusters_;
};

// Stonefish's application without its loop and clock: a tick is made when it is asked for.
class App : public sf::ConsoleSimulationApp
{
public:
    App(const std::string& folder, World* world) : sf::ConsoleSimulationApp("hydro-stonefish", folder, world)
    {
        autostep_ = false;
    }

    void begin()
    {
        Init();
    }
};

struct Motion
{
    sf::Transform pose;       // of O, NED
    sf::Vector3 velocity;     // of O, NED
    sf::Vector3 turn;         // NED
};

class Bridge
{
public:
    Bridge(const std::string& scenario, const std::string& folder, const Settings& settings)
        : settings_(settings), world_(scenario, settings), app_(folder, &world_)
    {
        app_.begin();
    }

    size_t thrusters() const
    {
        return world_.thrusters().size();
    }

    void reset(const std::vector<double>& at)
    {
        // The first tick tells what is felt at the beginning; the motion then begins anew.
        place(at);
        const Motion before = motion();
        tick();
        felt_ = feel(before, motion());
        place(at);
    }

    void hold(int ticks, const std::vector<double>& setpoints)
    {
        for (size_t i = 0; i < setpoints.size(); ++i)
            world_.thrusters()[i]->setSetpoint(setpoints[i]);
        for (int k = 0; k < ticks; ++k)
        {
            const Motion before = motion();
            tick();
            felt_ = feel(before, motion());
        }
    }

    std::string row()
    {
        const Motion now = motion();
        const sf::Matrix3 toBody = now.pose.getBasis().transpose();
        const sf::Quaternion q = now.pose.getRotation();
        std::ostringstream out;
        out.precision(17);
        out << "row";
        write(out, now.pose.getOrigin());
        out << ' ' << q.w() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z();
        write(out, toBody * now.velocity);
        write(out, toBody * now.turn);
        write(out, felt_);
        for (sf::Thruster* thruster : world_.thrusters())
            out << ' ' << thruster->getThrust();
        return out.str();
    }

private:
    static void write(std::ostream& out, const sf::Vector3& v)
    {
        out << ' ' << v.x() << ' ' << v.y() << ' ' << v.z();
    }

    btRigidBody& rigid()
    {
        return *world_.body().getRigidBody();
    }

    // Of Bullet's body itself: what Stonefish reads lags behind it by a tick.
    Motion motion()
    {
        const sf::Transform center = rigid().getCenterOfMassTransform();
        const sf::Transform pose = center * world_.body().getCG2OTransform();
        const sf::Vector3 velocity = rigid().getVelocityInLocalPoint(pose.getOrigin() - center.getOrigin());
        return {pose, velocity, rigid().getAngularVelocity()};
    }

    sf::Vector3 feel(const Motion& before, const Motion& after) const
    {
        const sf::Vector3 acceleration = (after.velocity - before.velocity) * settings_.rate;
        return after.pose.getBasis().transpose() * (acceleration - sf::Vector3(0, 0, settings_.gravity));
    }

    void tick()
    {
        world_.StepSimulation(1.0 / settings_.rate);
    }

    // The whole scenario is built anew: rotors, contacts and the phase of fluid forces are as at the beginning.
    void place(const std::vector<double>& at)
    {
        world_.RestartScenario();
        world_.StartSimulation();
        const sf::Transform pose(sf::Quaternion(at[4], at[5], at[6], at[3]), sf::Vector3(at[0], at[1], at[2]));
        const sf::Transform center = pose * world_.body().getCG2OTransform().inverse();
        const sf::Vector3 turn = pose.getBasis() * sf::Vector3(at[10], at[11], at[12]);
        const sf::Vector3 lever = center.getOrigin() - pose.getOrigin();
        const sf::Vector3 velocity = pose.getBasis() * sf::Vector3(at[7], at[8], at[9]) + turn.cross(lever);
        btRigidBody& body = rigid();
        body.setCenterOfMassTransform(center);
        body.setInterpolationWorldTransform(center);
        body.getMotionState()->setWorldTransform(center);
        body.setLinearVelocity(velocity);
        body.setAngularVelocity(turn);
        body.setInterpolationLinearVelocity(velocity);
        body.setInterpolationAngularVelocity(turn);
        world_.getDynamicsWorld()->updateAabbs();
    }

    Settings settings_;
    World world_;
    App app_;
    sf::Vector3 felt_ = sf::Vector3(0, 0, 0);
};

Settings settingsOf(const std::string& scenario)
{
    tinyxml2::XMLDocument document;
    if (document.LoadFile(scenario.c_str()) != tinyxml2::XML_SUCCESS)
        throw std::runtime_error(scenario + ": no scenario that can be read");
    Settings found;
    tinyxml2::XMLElement* root = document.FirstChildElement("scenario");
    tinyxml2::XMLElement* own = root == nullptr ? nullptr : root->FirstChildElement("hydro");
    tinyxml2::XMLElement* buoyancy = own == nullptr ? nullptr : own->FirstChildElement("buoyancy");
    const char* moment = nullptr;
    double x, y, z;
    if (buoyancy == nullptr || own->QueryAttribute("rate", &found.rate) != tinyxml2::XML_SUCCESS
        || own->QueryAttribute("gravity", &found.gravity) != tinyxml2::XML_SUCCESS
        || buoyancy->QueryAttribute("force", &found.buoyancy) != tinyxml2::XML_SUCCESS
        || buoyancy->QueryStringAttribute("moment", &moment) != tinyxml2::XML_SUCCESS
        || std::sscanf(moment, "%lf %lf %lf", &x, &y, &z) != 3 || found.rate <= 0.0)
        throw std::runtime_error(scenario + ": no element <hydro> with rate, gravity and buoyancy");
    found.moment = sf::Vector3(x, y, z);
    return found;
}

std::vector<double> numbers(std::istream& line, size_t count)
{
    std::vector<double> found(count);
    for (double& each : found)
        if (!(line >> each) || !std::isfinite(each))
            throw std::runtime_error("a request lacks a finite number");
    std::string more;
    if (line >> more)
        throw std::runtime_error("a request has numbers too many");
    return found;
}

// What stdout was: from here on Stonefish's own messages go to stderr.
FILE* answers()
{
    FILE* out = fdopen(dup(STDOUT_FILENO), "w");
    dup2(STDERR_FILENO, STDOUT_FILENO);
    return out;
}

void say(FILE* out, const std::string& line)
{
    std::fputs((line + "\n").c_str(), out);
    std::fflush(out);
}

void serve(const std::string& scenario, FILE* out)
{
    const size_t slash = scenario.find_last_of('/');
    const std::string folder = slash == std::string::npos ? "./" : scenario.substr(0, slash + 1);
    const Settings settings = settingsOf(scenario);
    Bridge bridge(scenario, folder, settings);
    std::ostringstream hello;
    hello << "hydro-stonefish " << PROTOCOL << ' ' << STONEFISH_VER << ' ' << settings.rate << ' '
          << bridge.thrusters();
    say(out, hello.str());
    bool placed = false;
    for (std::string text; std::getline(std::cin, text);)
    {
        std::istringstream line(text);
        std::string word;
        line >> word;
        if (word == "reset")
        {
            bridge.reset(numbers(line, 13));
            placed = true;
        }
        else if (word == "hold" && placed)
        {
            int ticks = 0;
            if (!(line >> ticks) || ticks < 1)
                throw std::runtime_error("hold needs a number of ticks");
            bridge.hold(ticks, numbers(line, bridge.thrusters()));
        }
        else
            throw std::runtime_error(word == "hold" ? "hold before reset" : "no such request: " + word);
        say(out, bridge.row());
    }
}

}  // namespace

int main(int argc, char** argv)
{
    FILE* out = answers();
    if (argc != 2)
    {
        say(out, "error usage: hydro-stonefish SCENARIO.scn");
        return 2;
    }
    try
    {
        serve(argv[1], out);
    }
    catch (const std::exception& error)
    {
        say(out, std::string("error ") + error.what());
        return 1;
    }
    return 0;
}
