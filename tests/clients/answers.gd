# The answers of the driver in GDScript to cases as in `samples/driver/vectors.json`: one text for Godot 3 and 4.

const Body = preload("wrinkle.gd")


# By case, the weights of its runs, the rounds that are played unseen, and what is said where a joint and a target are lost.
static func all(cases, clips):
	var found = {}
	for label in cases:
		var each = cases[label]
		var runs = []
		var unseen = []
		for run in each["runs"]:
			runs.append(played(Body.new(each["wrinkle"]), each, run, clips))
			unseen.append(Body.new(each["wrinkle"]).unseen_rounds(run["seconds"]))
		var joints = each["joints"].duplicate()
		var targets = each["targets"].duplicate()
		joints.pop_front()
		targets.pop_front()
		var problems = Body.new(each["wrinkle"], joints, targets).problems
		var later = each["wrinkle"].duplicate()
		later["layout"] = Body.LAYOUT + 1
		found[label] = {"runs": runs, "unseen": unseen, "problems": problems + Body.new(later).problems}
	return found


static func played(body, each, run, clips):
	var frames = []
	body.clips = clips
	for number in range(run["elapsed"].size()):
		var k = number % run["times"].size()
		var matrices = {}
		for joint in range(each["joints"].size()):
			matrices[each["joints"][joint]] = run["matrices"][k][joint]
		var morphs = {}
		for target in range(each["morphs"].size()):
			morphs[each["morphs"][target]] = run["morphs"][k][target]
		var hands = {}
		if run.get("hands", [null])[k if run.has("hands") else 0] != null:
			var hand = run["hands"][k]
			hands[each["wrinkle"]["touches"][0]["name"]] = {"slide": [hand[0], hand[1]], "depth": hand[2]}
		body.others = run.get("others", [{}])[k if run.has("others") else 0]
		var elapsed = NAN if run["elapsed"][number] == null else run["elapsed"][number]
		var weights = body.weights(matrices, morphs, run["clip"], run["times"][k], elapsed, hands)
		var row = []
		for target in each["targets"]:
			row.append(weights[target])
		frames.append(row)
	return frames
