// Finds `extras.wrinkle` in a .glb or .gltf file, as engines' importers leave extras out.

using System;
using System.Collections.Generic;
using System.Linq;
using System.Text;

namespace Wrinkles
{
    using Json = Dictionary<string, object>;

    public static class GltfExtras
    {
        /// <summary>By node's name its `extras.wrinkle`; FormatException if the file is not glTF.</summary>
        public static Dictionary<string, Json> Wrinkles(byte[] file)
        {
            // Of a .glb: 12 bytes of header, then the length and the kind of the chunk of JSON.
            var binary = file.Length > 20 && Encoding.ASCII.GetString(file, 0, 4) == "glTF";
            var text = binary ? Encoding.UTF8.GetString(file, 20, BitConverter.ToInt32(file, 12)) : Encoding.UTF8.GetString(file);
            if (!(JsonText.Parse(text) is Json gltf)) throw new FormatException("not glTF");
            var nodes = gltf.TryGetValue("nodes", out var all) ? ((List<object>)all).Cast<Json>() : new Json[0];
            var found = new Dictionary<string, Json>();
            foreach (var node in nodes)
                if (node.TryGetValue("extras", out var extras) && extras is Json keys && keys.TryGetValue("wrinkle", out var entry)
                    && entry is Json wrinkle && node.TryGetValue("name", out var name))
                    found[(string)name] = wrinkle;
            return found;
        }
    }
}
