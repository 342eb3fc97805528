// Drives that measure joints rather than lengths: folds, fields, and flesh that swings.

using System;
using System.Collections.Generic;
using System.Linq;

namespace Wrinkles
{
    using Json = Dictionary<string, object>;

    /// <summary>How a joint is turned against its parent, from its stored pose.</summary>
    sealed class Turning
    {
        /// <summary>Below this a turn has no axis.</summary>
        const double LeastSine = 1e-5;
        readonly string joint, parent;
        readonly double[][] rest;

        public Turning(Json data)
        {
            (joint, parent) = ((string)data["joint"], data.TryGetValue("parent", out var above) ? (string)above : null);
            var q = Read.Numbers(data["rest"]);
            var (x, y, z, w) = (q[0], q[1], q[2], q[3]);
            rest = new[]
            {
                new[] { 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w) },
                new[] { 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w) },
                new[] { 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y) },
            };
        }

        public string[] Joints => parent == null ? new[] { joint } : new[] { joint, parent };

        /// <summary>Four times sine and cosine of half the angle, the sine along the axis; and that sine alone.</summary>
        public (double[] sines, double cosine, double[] turned) At(Frame frame)
        {
            var own = V.Turn(frame.JointMatrix(joint));
            var above = parent == null ? new[] { new[] { 1.0, 0, 0 }, new[] { 0, 1.0, 0 }, new[] { 0, 0, 1.0 } }
                : V.Turn(frame.JointMatrix(parent));
            // Against the parent, by rows; and what that is from the stored pose.
            var local = above.Select(row => own.Select(column => V.Dot(row, column)).ToArray());
            var d = local.Select(row => rest.Select(each => V.Dot(row, each)).ToArray()).ToArray();
            var sines = new[] { d[2][1] - d[1][2], d[0][2] - d[2][0], d[1][0] - d[0][1] };
            var cosine = 1 + d[0][0] + d[1][1] + d[2][2];
            return (sines, cosine, sines.Select(each => each / (2 * Math.Sqrt(Math.Max(cosine, LeastSine * LeastSine)))).ToArray());
        }
    }

    /// <summary>A fold by the turn of the joint that folds: one whose skin touches and never crosses, or one of a field.</summary>
    sealed class Fold : Drive
    {
        /// <summary>The sine of half of 10°, and the squared distance below which two turns are the same.</summary>
        const double Near = 0.0872, Same = 1e-10;
        readonly Turning own, other;
        readonly double[] axis;
        readonly Rows table;
        // By path, rows of turns, and of weights.
        readonly double[][][] turns, there;

        public Fold(Json data) : base(data)
        {
            own = new Turning(data);
            other = data.TryGetValue("other", out var further) ? new Turning((Json)further) : null;
            axis = Read.Numbers(data["axis"]);
            table = new Rows(data["angles"], data["weights"]);
            // Where another joint folds the surface, too, rows of clips are by the turns of both.
            var paths = Read.List(data, other == null ? "paths" : "paths_with_other").Cast<Json>().ToList();
            turns = paths.Select(each => Read.Rows(each["turns"])).ToArray();
            there = paths.Select(each => Read.Rows(each["weights"])).ToArray();
        }

        public override IEnumerable<string> Joints => other == null ? own.Joints : own.Joints.Concat(other.Joints);

        public override double[] Weights(Frame frame, Func<string, double> morph)
        {
            var (sines, cosine, turned) = own.At(frame);
            var sums = table.At(2 * Math.Atan2(V.Dot(axis, sines), cosine));
            var turn = other == null ? turned : turned.Concat(other.At(frame).turned).ToArray();
            var whole = 1.0;
            for (var path = 0; path < turns.Length; path++)
                for (var row = 0; row + 1 < turns[path].Length; row++)
                {
                    var way = V.Minus(turns[path][row + 1], turns[path][row]);
                    var apart = V.Minus(turn, turns[path][row]);
                    var size = V.Dot(way, way);
                    var part = V.Clamp(V.Dot(apart, way) / (size > 0 ? size : 1), 0, 1);
                    var beside = apart.Select((each, i) => each - part * way[i]).ToArray();
                    var share = Math.Max(Near * Near / Math.Max(V.Dot(beside, beside), Same) - 1, 0);
                    Add(sums, there[path][row], share * (1 - part));
                    Add(sums, there[path][row + 1], share * part);
                    whole += share;
                }
            return sums.Select(sum => sum / whole).ToArray();
        }

        static void Add(double[] sums, double[] weights, double factor)
        {
            for (var k = 0; k < sums.Length; k++) sums[k] += factor * weights[k];
        }
    }

    /// <summary>A field of wrinkles: folds by the turns of some joints, the squares of whose weights add up, with signs, to 1 at most.</summary>
    sealed class Field : Drive
    {
        readonly Fold[] turns;
        // By turn, the places of its targets.
        readonly int[][] raises;
        readonly int count;

        public Field(Json data) : base(data)
        {
            var all = Read.List(data, "turns").Cast<Json>().ToArray();
            turns = all.Select(each => new Fold(each)).ToArray();
            count = Read.List(data, "targets").Count();
            raises = all.Select(each => Read.Numbers(each["raises"]).Select(place => (int)place).ToArray()).ToArray();
        }

        public override IEnumerable<string> Joints => turns.SelectMany(each => each.Joints);

        public override double[] Weights(Frame frame, Func<string, double> morph)
        {
            var sums = new double[count];
            for (var turn = 0; turn < turns.Length; turn++)
            {
                var weights = turns[turn].Weights(frame, morph);
                for (var k = 0; k < weights.Length; k++) sums[raises[turn][k]] += weights[k] * Math.Abs(weights[k]);
            }
            return sums.Select(sum => Math.Sqrt(Math.Min(Math.Max(sum, 0), 1))).ToArray();
        }
    }

    /// <summary>Flesh that swings after a joint, which goes along its clip's curve and beside that along the cubic through the
    /// last four frames.</summary>
    sealed class Flesh : Drive
    {
        /// <summary>Metres per second by which no body changes its speed within a frame: it has been put elsewhere.</summary>
        const double Leap = 10;
        /// <summary>The same where a clip's time runs back: a walk of a short step may be put back there.</summary>
        const double LeapAnew = 2.5;
        /// <summary>A frame that takes so many times as long as the one before, and so many seconds, tells no way.</summary>
        const double Hitch = 2, Long = 0.05;
        /// <summary>Steps per second, at least; within one, the joint's place runs straight.</summary>
        const double Steps = 360;
        static readonly Known Unknown = new Known { Path = part => new double[3], Beside = new double[3], Back = new double[3] };
        readonly string joint;
        readonly double[] at, gravity, gains;
        readonly double scale;
        readonly Spring[] springs;
        readonly double[][] loads;
        readonly Swing swing;
        // By mode, what a change of the joint's velocity does, and the places of rest; at the last frame.
        double[][] ways;
        double[] rests;
        // The last moves and the seconds that they took, the latest first.
        readonly List<double[]> moves = new List<double[]>();
        readonly List<double> steps = new List<double>();
        double[] place, velocity;
        string clip;
        double time;
        // By clip its seconds at the last frame.
        Dictionary<string, double> times = new Dictionary<string, double>();

        public Flesh(Json data) : base(data)
        {
            (joint, scale) = ((string)data["joint"], Read.Number(data["scale"]));
            (at, gravity) = (Read.Numbers(data["at"]), Read.Numbers(data["gravity"]));
            var modes = Read.List(data["modes"]).Cast<Json>().ToList();
            springs = modes.Select(each => new Spring(each)).ToArray();
            loads = modes.Select(each => Read.Numbers(each["load"])).ToArray();
            gains = modes.Select(each => Read.Number(each["gain"])).ToArray();
            swing = new Swing(springs);
        }

        public override IEnumerable<string> Joints => new[] { joint };
        public override IEnumerable<Spring> Springs => springs;

        public override double[] Weights(Frame frame, Func<string, double> morph)
        {
            var matrix = frame.JointMatrix(joint);
            var (shown, turn, ratio) = (V.Moved(matrix, at), V.Turn(matrix), V.Scale(matrix) / scale);
            var before = clip == frame.Clip ? time : double.NaN;
            var playing = frame.Others.Select(each => (name: each.Key, time: each.Value.time, share: each.Value.share)).ToList();
            playing.Add((frame.Clip ?? "", frame.Time, 1 - playing.Sum(each => each.share)));
            var blended = playing.Select(each => (each.name, each.time, times.TryGetValue(each.name, out var last) ? last : double.NaN, each.share));
            var known = frame.Clips?.Blended(joint, at, blended, frame.Elapsed, frame.Root) ?? Unknown;
            times = playing.ToDictionary(each => each.name, each => each.time);
            var now = shown.Select((x, i) => x + known.Beside[i]).ToArray();
            // Gravity as it was at rest is in the mesh already.
            var g = new[] { 0, 1, 2 }.Select(i => -turn[0][i] * gravity[0] - turn[1][i] * gravity[1] - turn[2][i] * gravity[2]).ToArray();
            g[1] -= V.Length(gravity);
            var size = ratio < 1e-6 ? 0 : 1 / ratio;
            var along = loads.Select((load, k) => new[] { 0, 1, 2 }.Select(i => gains[k] * size * (load[0] * turn[0][i] + load[1] * turn[1][i] + load[2] * turn[2][i])).ToArray()).ToArray();
            var resting = along.Select((way, k) => V.Dot(way, g) / (springs[k].Omega * springs[k].Omega)).ToArray();
            var leap = (frame.Time < before ? LeapAnew : Leap) * ratio * frame.Elapsed;
            (clip, time) = (frame.Clip, frame.Time);
            Advance(now, along, resting, frame.Elapsed, leap, known);
            (place, ways, rests) = (now, along, resting);
            var numbers = Swing.Limited(swing.Places).Select(each => ratio < 1e-6 ? 0 : each).ToArray();
            var least = Math.Min(0, numbers.Min());
            return numbers.Select(each => (each - least) / 2).Append(-least).ToArray();
        }

        /// <summary>Take the springs on by a frame that brings the joint to a place, no farther than it can run.</summary>
        void Advance(double[] now, double[][] along, double[] resting, double elapsed, double farthest, Known known)
        {
            if (place == null || !(elapsed >= 0))
            {
                swing.Rest(resting);
                velocity = null;
                moves.Clear();
                steps.Clear();
                return;
            }
            var seen = moves.Count > 0;
            var (first, last) = (known.Path(0), known.Path(1));
            var moved = V.Minus(V.Minus(now, place), V.Minus(last, first));
            var leap = seen ? moved.Select((x, i) => x - moves[0][i] * elapsed / steps[0]).ToArray() : moved;
            // In no time nothing moves: the body is put elsewhere. A player may put a walk back, or let it go on.
            var begins = elapsed > 0 && V.Dot(moved, known.Back) > V.Dot(known.Back, known.Back) / 2;
            if (begins) leap = known.Back;
            if (begins || elapsed == 0 || (seen && V.Length(leap) > farthest)) moved = V.Minus(moved, leap);
            if (elapsed == 0) return;
            var kept = seen && elapsed > Math.Max(Hitch * steps[0], Long) ? 0 : 2;
            if (moves.Count > kept) { moves.RemoveRange(kept, moves.Count - kept); steps.RemoveRange(kept, steps.Count - kept); }
            moves.Insert(0, moved);
            steps.Insert(0, elapsed);
            var powers = new[] { Cubic(0), Cubic(1), Cubic(2) };
            var count = (int)Math.Max(Math.Ceiling(Steps * elapsed - 1e-6), 1);
            var (span, here) = (elapsed / count, new double[3]);
            for (var step = 0; step < count; step++)
            {
                var (part, path, t) = ((double)step / count, known.Path((step + 1.0) / count), span * (step + 1));
                var there = powers.Select((p, i) => path[i] - first[i] + t * (p[1] + t * (p[2] + t * p[3]))).ToArray();
                var ahead = there.Select((x, i) => (x - here[i]) / span).ToArray();
                // A body that was already moving when it was first seen had flesh that moved along.
                var kick = V.Minus(velocity ?? ahead, ahead);
                var kicks = along.Select((way, k) => V.Dot(Blend(ways[k], way, part), kick) / springs[k].Omega).ToArray();
                swing.Pass(kicks, Blend(rests, resting, part), span);
                (here, velocity) = (there, ahead);
            }
        }

        static double[] Blend(double[] from, double[] to, double part) => from.Select((x, i) => x + part * (to[i] - x)).ToArray();

        /// <summary>Powers of time since the last frame of the cubic through the last moves along an axis.</summary>
        double[] Cubic(int i)
        {
            Func<int, double> slope = k => moves[k][i] / steps[k];
            Func<int, double> bend = k => (slope(k) - slope(k + 1)) / (steps[k] + steps[k + 1]);
            var (h, h1) = (steps[0], steps.Count > 1 ? steps[1] : 0);
            var two = moves.Count > 1 ? bend(0) : 0;
            var three = moves.Count > 2 ? (two - bend(1)) / (h + h1 + steps[2]) : 0;
            return new[] { 0, slope(0) - h * two - h * h1 * three, two + (h1 - h) * three, three };
        }
    }

    /// <summary>Springs that swing together within a limit of 1, by steps in which each is free.</summary>
    sealed class Swing
    {
        /// <summary>Greatest change of a swing per second, over its limit; iterations of Newton's method.</summary>
        const double Fastest = 24, Iterations = 30;
        /// <summary>Seconds over which a speed that the limit took counts against kicks the other way.</summary>
        const double Fade = 1.0 / 30;
        readonly Spring[] springs;
        double[] speeds, lost;
        public double[] Places;

        public Swing(Spring[] springs) { this.springs = springs; }

        /// <summary>Places none of which is beyond the limit.</summary>
        public static double[] Limited(double[] n) { var size = Math.Max(V.Length(n), 1); return n.Select(x => x / size).ToArray(); }

        /// <summary>Rest under steady loads F, where |n| = F (1 - |n|⁴).</summary>
        public void Rest(double[] loads)
        {
            var size = V.Length(loads);
            var found = Math.Min(size, 1);
            for (var k = 0; k < Iterations; k++) found -= (size * Math.Pow(found, 4) + found - size) / (4 * size * Math.Pow(found, 3) + 1);
            (speeds, lost) = (new double[loads.Length], new double[loads.Length]);
            Places = loads.Select(load => size > 0 ? load * found / size : 0).ToArray();
        }

        /// <summary>Of a push, |n|⁴ of what goes further out does not act.</summary>
        double[] Inward(double[] push)
        {
            var outwards = V.Dot(Places, Places) * Math.Max(V.Dot(Places, push), 0);
            return push.Select((each, k) => each - outwards * Places[k]).ToArray();
        }

        /// <summary>Some seconds that begin with `kicks` of the speeds over ω, under steady `loads`.</summary>
        public void Pass(double[] kicks, double[] loads, double seconds)
        {
            var (pushes, rest, size) = (Inward(kicks), Inward(loads), V.Dot(lost, lost));
            var share = size > 0 ? Math.Min(Math.Max(-V.Dot(pushes, lost), 0), size) / size : 0;
            var kicked = pushes.Select((push, k) => speeds[k] + push + share * lost[k]).ToArray();
            var (taken, room) = (0.0, Math.Max(1 - V.Dot(Places, Places), 0));
            for (var k = 0; k < springs.Length; k++) taken += Math.Pow(kicked[k] * Math.Max(springs[k].Omega / Fastest, 1), 2);
            var kept = taken > room ? Math.Sqrt(room / taken) : 1;
            var fade = Math.Exp(-seconds / Fade);
            lost = lost.Select((each, k) => fade * ((1 - share) * each + (1 - kept) * kicked[k])).ToArray();
            Places = Limited(Places);
            for (var k = 0; k < springs.Length; k++)
            {
                springs[k].Decay(springs[k].Omega * seconds, out var c, out var s);
                var (y, u, damping) = (Places[k] - rest[k], kept * kicked[k], springs[k].Damping);
                (Places[k], speeds[k]) = (rest[k] + c * y + s * (u + damping * y), c * u - s * (y + damping * u));
            }
        }
    }
}
