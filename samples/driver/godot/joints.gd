# Drives that measure joints rather than lengths: folds, those of fields too, flesh that swings, and tips that slide the skin.
# One text for Godot 3 and 4; `body` is of `wrinkle.gd`.

const Numbers = preload("numbers.gd")

# Of folds: below the first a turn has no axis; the sine of half of 10 degrees, and the squared distance below which two
# turns are the same.
const LEAST_SINE = 1e-5
const NEAR = 0.0872
const SAME = 1e-10
# Of flesh: metres per second by which no body changes its speed within a frame, and the same where a clip's time runs
# back, as a walk of a short step may be put back there; a frame that takes so many times as long as the one before, and
# so many seconds, tells no way.
const LEAP = 10.0
const LEAP_ANEW = 2.5
const HITCH = 2.0
const LONG = 0.05
# What is known of the motion of a joint without its clip.
const NONE = [0.0, 0.0, 0.0]
const UNKNOWN = {"path": null, "beside": NONE, "back": NONE}


# How a joint is turned from its stored pose: four times sine and cosine of half the angle, the sine along the axis.
static func _turn(body, data):
	var q = data["rest"]
	var x = q[0]
	var y = q[1]
	var z = q[2]
	var w = q[3]
	var rest = [
		[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
		[2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
		[2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
	]
	var own = Numbers.turn(body.matrices[data["joint"]])
	var above = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
	if data.has("parent"):
		above = Numbers.turn(body.matrices[data["parent"]])
	# Against the parent, by rows, from the stored pose.
	var d = []
	for row in above:
		var local = [Numbers.dot(row, own[0]), Numbers.dot(row, own[1]), Numbers.dot(row, own[2])]
		d.append([Numbers.dot(local, rest[0]), Numbers.dot(local, rest[1]), Numbers.dot(local, rest[2])])
	var sines = [d[2][1] - d[1][2], d[0][2] - d[2][0], d[1][0] - d[0][1]]
	return [sines, 1.0 + d[0][0] + d[1][1] + d[2][2]]


# The sine alone.
static func _turned(found):
	return Numbers.times(0.5 / sqrt(Numbers.larger(found[1], LEAST_SINE * LEAST_SINE)), found[0])


static func fold(body, data):
	var found = _turn(body, data)
	var angle = 2.0 * atan2(Numbers.dot(data["axis"], found[0]), found[1])
	var sums = Numbers.row(data["angles"], data["weights"], angle)
	# Where another joint folds the surface, too, rows of clips are by the turns of both.
	var turn = _turned(found) + (_turned(_turn(body, data["other"])) if data.has("other") else [])
	var whole = 1.0
	for path in data.get("paths_with_other", data.get("paths", [])):
		for k in range(path["turns"].size() - 1):
			var way = Numbers.sum(path["turns"][k + 1], path["turns"][k], -1.0)
			var apart = Numbers.sum(turn, path["turns"][k], -1.0)
			var size = Numbers.dot(way, way)
			var part = Numbers.held(Numbers.dot(apart, way) / (size if size > 0 else 1.0), 0.0, 1.0)
			var beside = Numbers.sum(apart, way, -part)
			var share = Numbers.larger(NEAR * NEAR / Numbers.larger(Numbers.dot(beside, beside), SAME) - 1.0, 0.0)
			sums = Numbers.sum(sums, path["weights"][k], share * (1.0 - part))
			sums = Numbers.sum(sums, path["weights"][k + 1], share * part)
			whole += share
	return Numbers.times(1.0 / whole, sums)


# The roots of the sums of the squares, with signs, of the weights of all turns, at most 1.
static func field(body, data):
	var sums = Numbers.times(0.0, range(data["targets"].size()))
	for turn in data["turns"]:
		var weights = fold(body, turn)
		for k in range(weights.size()):
			sums[int(turn["raises"][k])] += weights[k] * abs(weights[k])
	for k in range(sums.size()):
		sums[k] = sqrt(Numbers.smaller(Numbers.larger(sums[k], 0.0), 1.0))
	return sums


static func flesh(body, data, state):
	var matrix = body.matrices[data["joint"]]
	var before = state["time"] if state.get("clip") == body.clip else NAN
	var known = UNKNOWN
	if body.clips != null:
		var last = state.get("times", {})
		var times = {}
		var playing = []
		var rest = 1.0
		for other in body.others:
			var share = body.others[other]["share"]
			rest -= share
			times[other] = body.others[other]["time"]
			playing.append([other, times[other], last.get(other, NAN), share])
		playing.append([body.clip, body.time, last.get(body.clip, NAN), rest])
		times[body.clip] = body.time
		state["times"] = times
		known = body.clips.blended(data["joint"], data["at"], playing, body.elapsed, body.root)
	var place = Numbers.sum(Numbers.moved(matrix, data["at"]), known["beside"])
	var turn = Numbers.turn(matrix)
	var ratio = Numbers.scale(matrix) / data["scale"]
	# Gravity as it was at rest is in the mesh already.
	var pull = [0.0, -Numbers.length(data["gravity"]), 0.0]
	for k in range(3):
		pull = Numbers.sum(pull, turn[k], -data["gravity"][k])
	var farthest = (LEAP_ANEW if body.time < before else LEAP) * ratio * body.elapsed
	state["clip"] = body.clip
	state["time"] = body.time
	var shown = 0.0 if ratio < 1e-6 else 1.0 / ratio
	var ways = []
	var loads = []
	for mode in data["modes"]:
		var way = NONE
		for k in range(3):
			way = Numbers.sum(way, turn[k], mode["gain"] * shown * mode["load"][k])
		ways.append(way)
		loads.append(Numbers.dot(way, pull) / pow(2.0 * PI * mode["frequency"], 2))
	_advance(body.elapsed, data["modes"], state, place, ways, loads, farthest, known)
	state["place"] = place
	state["ways"] = ways
	state["loads"] = loads
	var numbers = Numbers.times(0.0 if ratio < 1e-6 else 1.0, Numbers.limited(state["swing"][0]))
	var least = 0.0
	for each in numbers:
		least = Numbers.smaller(least, each)
	var found = []
	for each in numbers:
		found.append((each - least) / 2.0)
	return found + [-least]


# Takes the springs on by a frame that brings the joint to a place, along the cubic through the last four frames.
static func _advance(elapsed, modes, state, place, ways, loads, farthest, known):
	if not state.has("swing") or not elapsed >= 0:
		state["swing"] = [Numbers.rested(loads), Numbers.times(0.0, loads), Numbers.times(0.0, loads)]
		state["moves"] = []
		state["steps"] = []
		state["velocity"] = null
		return
	var count = Numbers.steps(elapsed)
	var path = known["path"]
	if path == null:
		path = []
		for _k in range(count + 1):
			path.append(NONE)
	var seen = state["moves"].size() > 0
	var moved = Numbers.sum(Numbers.sum(place, state["place"], -1.0), Numbers.sum(path[count], path[0], -1.0), -1.0)
	var leap = Numbers.sum(moved, state["moves"][0], -elapsed / state["steps"][0]) if seen else moved
	# In no time nothing moves: the body is put elsewhere. A player may put a walk back, or let it go on.
	var back = known["back"]
	var begins = elapsed > 0 and Numbers.dot(moved, back) > Numbers.dot(back, back) / 2.0
	if begins:
		leap = back
	if begins or elapsed == 0 or (seen and Numbers.length(leap) > farthest):
		moved = Numbers.sum(moved, leap, -1.0)
	if elapsed == 0:
		return
	if seen and elapsed > Numbers.larger(HITCH * state["steps"][0], LONG):
		state["moves"] = []
		state["steps"] = []
	while state["moves"].size() > 2:
		state["moves"].pop_back()
		state["steps"].pop_back()
	state["moves"].push_front(moved)
	state["steps"].push_front(elapsed)
	var powers = []
	for i in range(3):
		powers.append(_cubic(state["moves"], state["steps"], i))
	var here = NONE
	var span = elapsed / count
	for step in range(count):
		var part = step / float(count)
		var t = span * (step + 1)
		var there = Numbers.sum(path[step + 1], path[0], -1.0)
		for i in range(3):
			there[i] += t * (powers[i][1] + t * (powers[i][2] + t * powers[i][3]))
		var ahead = Numbers.times(1.0 / span, Numbers.sum(there, here, -1.0))
		# A body that was already moving when it was first seen had flesh that moved along.
		var kick = NONE if state["velocity"] == null else Numbers.sum(state["velocity"], ahead, -1.0)
		var kicks = []
		for k in range(modes.size()):
			var way = Numbers.blend(state["ways"][k], ways[k], part)
			kicks.append(Numbers.dot(way, kick) / (2.0 * PI * modes[k]["frequency"]))
		state["swing"] = Numbers.swung(state["swing"], modes, kicks, Numbers.blend(state["loads"], loads, part), span)
		here = there
		state["velocity"] = ahead


# Powers of time since the last frame of the cubic through the last moves along an axis.
static func _cubic(moves, steps, i):
	var slopes = []
	for k in range(moves.size()):
		slopes.append(moves[k][i] / steps[k])
	var h = steps[0]
	var h1 = steps[1] if steps.size() > 1 else 0.0
	var two = (slopes[0] - slopes[1]) / (h + h1) if moves.size() > 1 else 0.0
	var three = 0.0
	if moves.size() > 2:
		three = (two - (slopes[1] - slopes[2]) / (h1 + steps[2])) / (h + h1 + steps[2])
	return [0.0, slopes[0] - h * two - h * h1 * three, two + (h1 - h) * three, three]


static func touch(body, data, state, hand):
	var contact = _contact(body, data, state, hand)
	var spots = _spots(data)
	var grip = data["grip"]
	var slide = [contact[0] / grip, contact[1] / grip]
	slide = Numbers.times(1.0 / Numbers.larger(Numbers.length(slide), 1.0), slide)
	var found = []
	var turn = data["turn"] if data.has("turn") else 0.0
	var along = cos(turn) * slide[0] + sin(turn) * slide[1]
	var across = cos(turn) * slide[1] - sin(turn) * slide[0]
	var ways = []
	for way in [along, across, -along, -across]:
		ways.append(Numbers.larger(way, 0.0))
	if spots.size() > 1:
		var shares = _shares(data, contact[3])
		for k in range(spots.size()):
			found += Numbers.times(shares[k], [ways[0], ways[2]]) + _rings(spots[k], Numbers.times(shares[k], slide))
		return found
	found += ways
	found.append(Numbers.held(contact[2] / data["deepest"], 0.0, 1.0))
	found += _rings(data, slide)
	if data.has("limb"):
		var sine = _bend(body, data)
		for side in [sine, -sine]:
			found += Numbers.times(Numbers.larger(side, 0.0), ways)
	return found


# A touch's places: its own, and the further ones of its row.
static func _spots(data):
	return [data] + (data["row"] if data.has("row") else [])


# The weights of a place's rings at a slide over the greatest.
static func _rings(spot, slide):
	var length = Numbers.length(slide)
	var height = Numbers.point(spot["rises"], length) / length if length > 0 else 0.0
	var found = []
	for window in spot["windows"]:
		found.append(height * Numbers.larger(slide[0] * cos(window) + slide[1] * sin(window), 0.0))
	return found


# The distance from a place to the nearest one on the row, along it.
static func _beside(data, along):
	return along - Numbers.held(along, 0.0, data["row"].size() * data["spacing"]) if data.has("row") else along


# The shares of the places at a distance along the row: those of two neighbours sum to 1.
static func _shares(data, along):
	var passed = (along - _beside(data, along)) / data["spacing"] if data.has("row") else 0.0
	var found = []
	for k in range(_spots(data).size()):
		found.append(Numbers.larger(1.0 - abs(passed - k), 0.0))
	return found


# The sine of the bend of the limb beyond the joint, towards the skin.
static func _bend(body, data):
	var middle = body.placed(data["anchors"][0])[0]
	var axes = []
	for k in [1, 2, 3]:
		axes.append(Numbers.sum(body.placed(data["anchors"][k])[0], middle, -1.0))
	var volume = Numbers.dot(axes[0], Numbers.cross(axes[1], axes[2]))
	var way = Numbers.sum(body.placed(data["limb"][1])[0], body.placed(data["limb"][0])[0], -1.0)
	return Numbers.held(Numbers.dot(way, Numbers.cross(axes[0], axes[1])) / volume, -1.0, 1.0) if volume != 0 else 0.0


# Where a place of the world is: forward, sideways and above the skin, scene units at rest; forward is along the row. Null
# where the skin is scaled to nothing.
static func _on_skin(body, data, place):
	var spots = _spots(data)
	var each = []
	for spot in spots:
		each.append(_on_spot(body, spot, data["pad"], place))
		if each[-1] == null:
			return null
	var along = 0.0
	for k in range(spots.size() - 1):
		along += Numbers.held(each[k][0], 0.0, data["spacing"])
	var shares = _shares(data, along)
	var found = [0.0, 0.0, 0.0]
	for k in range(spots.size()):
		var ahead = k * data["spacing"] if k > 0 else 0.0
		found = Numbers.sum(found, Numbers.sum(each[k], [ahead, 0.0, 0.0], 1.0), shares[k])
	return found


static func _on_spot(body, spot, pad, place):
	var middle = body.placed(spot["anchors"][0])[0]
	var axes = []
	for k in [1, 2, 3]:
		axes.append(Numbers.sum(body.placed(spot["anchors"][k])[0], middle, -1.0))
	var way = Numbers.sum(place, middle, -1.0)
	var volume = Numbers.dot(axes[0], Numbers.cross(axes[1], axes[2])) / pad
	if not abs(volume) >= 1e-18 * pad * pad:
		return null
	var f = Numbers.dot(way, Numbers.cross(axes[1], axes[2])) / volume
	var s = Numbers.dot(way, Numbers.cross(axes[2], axes[0])) / volume
	var h = Numbers.dot(way, Numbers.cross(axes[0], axes[1])) / volume
	return [f, s, h - spot["bend"][0] * f * f - spot["bend"][1] * f * s - spot["bend"][2] * s * s]


# [forward, sideways, depth, along the row]: keyed, asked for, of the tip, or what is left of the last.
static func _contact(body, data, state, hand):
	if hand == null and data.get("keys", {}).has(body.clip):
		var rows = data["keys"][body.clip]
		var rest = Numbers.remaining(data["release"], body.time - rows[-1][0])
		var depth = Numbers.larger(Numbers.point(rows, body.time, 3), 0.0)
		return Numbers.times(rest, [Numbers.point(rows, body.time, 1), Numbers.point(rows, body.time, 2), depth, 0.0])
	# Where the seconds since the last frame are not known, the skin is at rest.
	if not body.elapsed >= 0:
		state.clear()
	var deepest = data["deepest"]
	var now = null
	if data.has("by") and hand == null:
		now = _on_skin(body, data, body.placed(data["by"])[0])
	var before = state.get("tip")
	if before == null:
		before = now
	var held = state.get("held", false)
	var touches = hand != null
	if now != null:
		touches = now[2] < deepest and Numbers.length([_beside(data, now[0]), now[1]]) < data["pad"] + (data["grip"] if held else 0.0)
	# Within a frame the tip comes or goes where it passes that height.
	var part = 0.0
	if now != null and touches != held and before[2] != now[2]:
		part = Numbers.held((before[2] - deepest) / (before[2] - now[2]), 0.0, 1.0)
	# When that is, a clip that was baked knows better than the heights at both ends of the frame.
	var gone = part
	if state.get("clip") == body.clip:
		for end in data.get("ends", {}).get(body.clip, []):
			if state["time"] < end and end <= body.time:
				gone = (end - state["time"]) / (body.time - state["time"])
	var asked = state.get("slide", [0.0, 0.0])
	var end = null
	if hand != null:
		asked = hand["slide"]
	elif now != null and (touches or held):
		var edge = Numbers.sum(before, Numbers.sum(now, before, -1.0), part)
		var from = before if held else edge
		var to = now if touches else edge
		asked = [asked[0] + to[0] - from[0], asked[1] + to[1] - from[1]]
		end = to
	if touches or held:
		# Beyond its grip the tip slips.
		var slip = data["grip"] / Numbers.larger(Numbers.length(asked), 1e-30)
		state["left"] = Numbers.times(Numbers.smaller(1.0, slip), asked)
		if hand != null:
			state["along"] = hand.get("along", 0.0)
		elif end != null:
			state["along"] = end[0] - state["left"][0]
		state["since"] = -gone * body.elapsed if state.get("tip") != null and not touches else 0.0
	if not touches and body.elapsed > 0:
		state["since"] = state.get("since", 0.0) + body.elapsed
	var remaining = 1.0 if touches else Numbers.remaining(data["release"], state.get("since", 0.0))
	var pressed = 0.0
	if touches:
		pressed = Numbers.held(hand["depth"] if hand != null else -now[2], 0.0, deepest)
	state["clip"] = body.clip
	state["time"] = body.time
	state["tip"] = now
	state["held"] = touches
	state["slide"] = Numbers.times(remaining, state.get("left", [0.0, 0.0]))
	return [state["slide"][0], state["slide"][1], pressed, state.get("along", 0.0)]
